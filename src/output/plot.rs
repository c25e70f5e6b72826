//! Line plots as SVG, without fonts or any other system library.
//!
//! Axes are linear or decadic; ticks are chosen here (steps of 1, 2 or 5, whole decades), because
//! plotters' own logarithmic axes leave out most labels.
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::ops::Range;

/// One axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// Quantity with unit, `time [ms]`.
    pub label: String,
    /// True for a decadic axis; values that are not positive are left out.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Axis { label: label.into(), log: false }
    }
    /// A decadic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Axis { label: label.into(), log: true }
    }
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    #[default]
    Line,
    /// Dots joined by a line: few points, each of them a result.
    Dots,
    /// A thin dashed line in the colour of the series with this number, which is held against it.
    LimitOf(usize),
}

/// One curve.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name in the legend; no entry if empty.
    pub label: String,
    /// Points in the order in which they are joined; non-finite ones are left out.
    pub points: Vec<(f64, f64)>,
    /// Half widths of error bars in y, one per point, or empty.
    pub half_widths: Vec<f64>,
    /// Look.
    pub mark: Mark,
}

impl Series {
    /// A curve drawn as a line.
    pub fn line(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { label: label.into(), points, ..Default::default() }
    }
    /// Single results, joined.
    pub fn dots(label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { label: label.into(), points, mark: Mark::Dots, ..Default::default() }
    }
    /// What the series with this number is held against.
    pub fn limit_of(series: usize, points: Vec<(f64, f64)>) -> Self {
        Series { points, mark: Mark::LimitOf(series), ..Default::default() }
    }
}

/// A diagram.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Line above the diagram; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Curves, in the order of the legend.
    pub series: Vec<Series>,
}

/// Colours of the curves (Okabe and Ito 2008, without the yellow that white paper swallows).
pub(crate) const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(60, 60, 60),
];

/// An SVG picture with one diagram.
pub fn line_plot(plot: &Plot, size: (u32, u32)) -> String {
    panels(std::slice::from_ref(plot), size)
}

/// An SVG picture with diagrams above each other.
pub fn panels(plots: &[Plot], size: (u32, u32)) -> String {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE).expect(SVG);
        for (area, plot) in root.split_evenly((plots.len().max(1), 1)).iter().zip(plots) {
            draw(area, plot);
        }
        root.present().expect(SVG);
    }
    svg
}

/// Why drawing cannot fail.
pub(crate) const SVG: &str = "writing SVG to memory does not fail";

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw(area: &Area<'_>, plot: &Plot) {
    let place = |axis: &Axis, v: f64| if axis.log { v.log10() } else { v };
    // Points and error bars in axis coordinates.
    let curves: Vec<Vec<[f64; 4]>> = plot
        .series
        .iter()
        .map(|s| {
            let bar = |i: usize| s.half_widths.get(i).copied().unwrap_or(0.0);
            let all = s.points.iter().enumerate().map(|(i, (x, y))| {
                let low = if plot.y.log && *y - bar(i) <= 0.0 { *y } else { *y - bar(i) };
                [place(&plot.x, *x), place(&plot.y, *y), place(&plot.y, low), place(&plot.y, y + bar(i))]
            });
            all.filter(|p| p.iter().all(|c| c.is_finite())).collect()
        })
        .collect();
    let x = range(curves.iter().flatten().map(|p| p[0]), plot.x.log, 0.0);
    let y = range(curves.iter().flatten().flat_map(|p| p[1..].iter().copied()), plot.y.log, 0.05);
    let mut chart = frame(area, &plot.title, (&plot.x, x), (&plot.y, y));
    for (i, (series, points)) in plot.series.iter().zip(&curves).enumerate() {
        if let Mark::LimitOf(other) = series.mark {
            let style = COLOURS[other % COLOURS.len()].stroke_width(1);
            chart.draw_series(DashedLineSeries::new(points.iter().map(|p| (p[0], p[1])), 5, 4, style)).expect(SVG);
            continue;
        }
        let colour = COLOURS[i % COLOURS.len()];
        let style = colour.stroke_width(2);
        let line = chart.draw_series(LineSeries::new(points.iter().map(|p| (p[0], p[1])), style)).expect(SVG);
        if !series.label.is_empty() {
            line.label(&series.label).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        if !series.half_widths.is_empty() {
            let bars = points.iter().map(|p| ErrorBar::new_vertical(p[0], p[2], p[1], p[3], colour.filled(), 7));
            chart.draw_series(bars).expect(SVG);
        } else if series.mark == Mark::Dots {
            chart.draw_series(points.iter().map(|p| Circle::new((p[0], p[1]), 4, colour.filled()))).expect(SVG);
        }
    }
    if plot.series.iter().any(|s| !s.label.is_empty()) {
        chart
            .configure_series_labels()
            .position(emptiest_corner(&curves, x, y))
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(200, 200, 200))
            .label_font(("sans-serif", 13))
            .draw()
            .expect(SVG);
    }
}

/// The empty diagram: title, both axes with their ranges, grid and labels.
pub(crate) fn frame<'a>(
    area: &Area<'a>,
    title: &str,
    (x_axis, x): (&Axis, (f64, f64)),
    (y_axis, y): (&Axis, (f64, f64)),
) -> ChartContext<'a, SVGBackend<'a>, Cartesian2d<Scale, Scale>> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).margin_right(24).x_label_area_size(44).y_label_area_size(82);
    if !title.is_empty() {
        builder.caption(title, ("sans-serif", 17));
    }
    let mut chart = builder.build_cartesian_2d(Scale::new(x, x_axis.log), Scale::new(y, y_axis.log)).expect(SVG);
    chart
        .configure_mesh()
        .x_desc(&x_axis.label)
        .y_desc(&y_axis.label)
        .max_light_lines(0)
        .bold_line_style(RGBColor(225, 225, 225))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 15))
        .draw()
        .expect(SVG);
    chart
}

/// The corner in whose third of the diagram the fewest points lie.
fn emptiest_corner(curves: &[Vec<[f64; 4]>], x: (f64, f64), y: (f64, f64)) -> SeriesLabelPosition {
    use SeriesLabelPosition as P;
    let third = |v: f64, range: (f64, f64)| (3.0 * (v - range.0) / (range.1 - range.0)).floor().clamp(0.0, 2.0) as usize;
    // Curves of many points must not drown those of few.
    let crowd = |cx: usize, cy: usize| -> f64 {
        let part = |c: &Vec<[f64; 4]>| {
            let inside = c.iter().filter(|p| third(p[0], x) == cx && third(p[1], y) == cy).count();
            inside as f64 / c.len().max(1) as f64
        };
        curves.iter().map(part).sum()
    };
    let corners = [(P::UpperRight, 2, 2), (P::LowerRight, 2, 0), (P::UpperLeft, 0, 2), (P::LowerLeft, 0, 0)];
    let best = corners.into_iter().min_by(|a, b| crowd(a.1, a.2).total_cmp(&crowd(b.1, b.2)));
    best.map_or(P::UpperRight, |b| b.0)
}

/// A linear coordinate with its own ticks and labels.
pub(crate) struct Scale {
    range: (f64, f64),
    ticks: Vec<f64>,
    log: bool,
}

impl Scale {
    /// A coordinate over a range; of a decadic one the range of the logarithms.
    pub(crate) fn new(range: (f64, f64), log: bool) -> Self {
        Scale { range, ticks: ticks(range, log), log }
    }

    /// A linear coordinate with a tick at 0, 1, 2, ..., for things that are counted, with some `air` above.
    pub(crate) fn counted(count: usize, air: f64) -> Self {
        let ticks = (0..count).map(|i| i as f64).collect();
        Scale { range: (-0.6, count.max(1) as f64 - 0.4 + air), ticks, log: false }
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;
    fn map(&self, value: &f64, (low, high): (i32, i32)) -> i32 {
        let s = (value - self.range.0) / (self.range.1 - self.range.0);
        low + (s * f64::from(high - low)).round() as i32
    }
    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }
    fn range(&self) -> Range<f64> {
        self.range.0..self.range.1
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        tick_label(*value, &self.ticks, self.log)
    }
}

/// Range of the values with some air; never empty.
pub(crate) fn range(values: impl Iterator<Item = f64>, log: bool, air: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let span = high - low;
    // A constant gets a range around itself that its own digits can resolve.
    let least = if log { 0.3 } else { 1e-6 * low.abs().max(high.abs()) };
    if span <= least {
        let half = if log { 0.5 } else { (0.5 * low.abs()).max(if low == 0.0 { 0.5 } else { 0.0 }) };
        return (0.5 * (low + high) - half, 0.5 * (low + high) + half);
    }
    (low - air * span, high + air * span)
}

/// About six ticks: steps of 1, 2 or 5; whole decades where there are enough of them.
fn ticks((low, high): (f64, f64), log: bool) -> Vec<f64> {
    if log {
        let decades = ((low.ceil() as i64)..=(high.floor() as i64)).collect::<Vec<_>>();
        if decades.len() >= 3 {
            let stride = decades.len().div_ceil(8) as i64;
            return decades.into_iter().filter(|d| d.rem_euclid(stride) == 0).map(|d| d as f64).collect();
        }
        let parts = |multiples: &[f64]| -> Vec<f64> {
            let all = (low.floor() as i64..=high.ceil() as i64).flat_map(|d| multiples.iter().map(move |m| m.log10() + d as f64));
            // The ends count although a logarithm has rounded them.
            all.filter(|t| *t >= low - 1e-9 && *t <= high + 1e-9).collect()
        };
        let few = parts(&[1.0, 2.0, 5.0]);
        return if few.len() < 3 { parts(&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]) } else { few };
    }
    let raw = (high - low) / 6.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw).unwrap_or(raw);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last).map(|i| i as f64 * step).collect()
}

/// As many digits as the distance of the ticks asks for.
fn tick_label(v: f64, ticks: &[f64], log: bool) -> String {
    if log {
        let x = 10f64.powf(v);
        return if (1e-3..1e5).contains(&x) { trim(format!("{x:.4}")) } else { trim_exponent(format!("{x:.1e}")) };
    }
    let largest = ticks.iter().fold(0.0f64, |m, t| m.max(t.abs()));
    let step = if ticks.len() > 1 { ticks[1] - ticks[0] } else { largest.max(1.0) };
    if v.abs() < 1e-9 * largest {
        return "0".into();
    }
    if (1e-3..1e5).contains(&largest) {
        let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
        format!("{v:.digits$}")
    } else {
        let digits = (v.abs().log10().floor() - step.log10().floor()).clamp(0.0, 9.0) as usize;
        trim_exponent(format!("{v:.digits$e}"))
    }
}

fn trim(s: String) -> String {
    if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s }
}

fn trim_exponent(s: String) -> String {
    match s.split_once('e') {
        Some((m, e)) => format!("{}e{e}", trim(m.to_owned())),
        None => s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(ticks((0.0, 1.0), false).len(), 6);
        assert_eq!(
            ticks((2.19, 3.66), false).iter().map(|t| tick_label(*t, &[2.2, 2.4], false)).collect::<Vec<_>>(),
            ["2.5", "3.0", "3.5"]
        );
        assert_eq!(ticks((-7.2, -2.8), true), [-7.0, -6.0, -5.0, -4.0, -3.0]);
        let labels: Vec<String> = ticks((0.0, 1.0), true).iter().map(|t| tick_label(*t, &[], true)).collect();
        assert_eq!(labels, ["1", "2", "5", "10"]);
        let narrow: Vec<String> = ticks((40f64.log10(), 80f64.log10()), true).iter().map(|t| tick_label(*t, &[], true)).collect();
        assert_eq!(narrow, ["40", "50", "60", "70", "80"], "a range with one of 1, 2, 5 in it has other ticks");
        assert_eq!(tick_label(3e-7, &[1e-7, 2e-7], false), "3e-7");
        assert_eq!(tick_label(-6.0, &[], true), "1e-6");
    }

    #[test]
    fn curves_labels_and_legend_are_in_the_picture() {
        let plot = Plot {
            title: "Pull".into(),
            x: Axis::linear("time [ms]"),
            y: Axis::log("energy [mJ]"),
            series: vec![
                Series::line("kinetic", vec![(0.0, 0.0), (1.0, 1e-3), (2.0, 1e-1)]),
                Series { half_widths: vec![0.5; 2], ..Series::dots("strain", vec![(0.0, 1.0), (2.0, 10.0)]) },
            ],
        };
        let svg = line_plot(&plot, (640, 400));
        for text in ["<svg", "</svg>", "time [ms]", "energy [mJ]", "kinetic", "strain", "Pull", "0.001"] {
            assert!(svg.contains(text), "{text} is missing");
        }
        // The first point of the kinetic energy is zero and has no place on a decadic axis.
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_to_show_and_constants_are_drawn_too() {
        let plot =
            |points| Plot { title: String::new(), x: Axis::linear("t"), y: Axis::linear("u"), series: vec![Series::line("a", points)] };
        for points in [vec![], vec![(0.0, f64::NAN)], vec![(0.0, 3.0)], vec![(0.0, -2e-9), (1.0, -2e-9)], vec![(0.0, 0.0), (1.0, 0.0)]] {
            let svg = panels(&[plot(points.clone()), plot(points)], (300, 400));
            assert!(svg.contains("</svg>") && !svg.contains("NaN"));
        }
    }
}
