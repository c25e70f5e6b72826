//! Diagrams of rows: a line per row with its value and interval, and error against time.
use crate::output::plot::{Axis, COLOURS, SVG, Scale, range};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A row of a [`RowChart`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mark {
    /// Name.
    pub label: String,
    /// Value; nothing is drawn without one.
    pub value: Option<f64>,
    /// Half width of its interval.
    pub half_width: Option<f64>,
    /// Interval of the reference, drawn behind.
    pub band: Option<(f64, f64)>,
    /// True for the reference itself.
    pub is_reference: bool,
    /// Numbers of others: index of the source, value, half width.
    pub others: Vec<(usize, f64, Option<f64>)>,
}

/// Values of rows, one below the other.
#[derive(Clone, Debug, PartialEq)]
pub struct RowChart {
    /// Line above the diagram.
    pub title: String,
    /// Axis of the values.
    pub x: Axis,
    /// Rows from top to bottom.
    pub rows: Vec<Mark>,
    /// True for bars from zero (or the edge of a decadic axis), false for dots.
    pub bars: bool,
    /// Sources of the numbers of others.
    pub sources: Vec<String>,
}

/// Colour of rows and of the reference.
const OWN: RGBColor = COLOURS[0];
const REFERENCE: RGBColor = COLOURS[2];
const FRONT: RGBColor = COLOURS[1];
/// Width of a character of the labels and height of a row, in pixels.
const CHARACTER: u32 = 8;
const HEIGHT: u32 = 30;

/// Place on an axis; none where it has none.
fn place(axis: &Axis, v: f64) -> Option<f64> {
    let p = if axis.log { v.log10() } else { v };
    p.is_finite().then_some(p)
}

impl RowChart {
    /// The diagram as SVG, `width` pixels wide.
    pub fn svg(&self, width: u32) -> String {
        let longest = self.rows.iter().map(|r| r.label.chars().count()).max().unwrap_or(0) as u32;
        let size = (width, HEIGHT * self.rows.len().max(1) as u32 + 90 + 18 * u32::from(!self.sources.is_empty()));
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            root.fill(&WHITE).expect(SVG);
            self.draw(&root, (CHARACTER * longest + 16).min(width / 2));
            root.present().expect(SVG);
        }
        svg
    }

    /// Middle and ends of an interval on the axis; a lower end without a place is the middle.
    fn interval(&self, value: f64, half: Option<f64>) -> Option<[f64; 3]> {
        let middle = place(&self.x, value)?;
        let half = half.unwrap_or(0.0);
        let ends = [value - half, value + half].map(|v| place(&self.x, v).unwrap_or(middle));
        Some([ends[0], middle, ends[1]])
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, labels: u32) {
        let n = self.rows.len();
        let marks: Vec<Option<[f64; 3]>> = self.rows.iter().map(|r| self.interval(r.value?, r.half_width)).collect();
        let others = self.rows.iter().flat_map(|r| &r.others).filter_map(|o| self.interval(o.1, o.2)).flatten();
        let bands = self.rows.iter().filter_map(|r| r.band).flat_map(|b| [b.0, b.1]).filter_map(|v| place(&self.x, v));
        let zero = (self.bars && !self.x.log).then_some(0.0);
        let all: Vec<f64> = marks.iter().flatten().flatten().copied().chain(others).chain(bands).chain(zero).collect();
        let (mut low, high) = range(all.into_iter(), self.x.log, 0.05);
        if self.bars && !self.x.log {
            low = low.min(0.0).max(if low < 0.0 && marks.iter().flatten().all(|m| m[0] >= 0.0) { 0.0 } else { low });
        }
        let mut builder = ChartBuilder::on(area);
        builder.margin(10).margin_right(28).x_label_area_size(42).y_label_area_size(labels);
        if !self.title.is_empty() {
            builder.caption(&self.title, ("sans-serif", 17));
        }
        let mut chart = builder.build_cartesian_2d(Scale::new((low, high), self.x.log), Scale::counted(n)).expect(SVG);
        let name = |y: &f64| n.checked_sub(1 + y.round() as usize).map_or(String::new(), |i| self.rows[i].label.clone());
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .max_light_lines(0)
            .bold_line_style(RGBColor(230, 230, 230))
            .y_labels(n)
            .y_label_formatter(&name)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 15))
            .draw()
            .expect(SVG);
        for (i, row) in self.rows.iter().enumerate() {
            let y = (n - 1 - i) as f64;
            if let Some((a, b)) = row.band.and_then(|b| place(&self.x, b.0).zip(place(&self.x, b.1))) {
                let band = Rectangle::new([(a, y - 0.5), (b, y + 0.5)], REFERENCE.mix(0.15).filled());
                chart.draw_series([band]).expect(SVG);
                let middle = PathElement::new([(0.5 * (a + b), y - 0.5), (0.5 * (a + b), y + 0.5)], REFERENCE.stroke_width(1));
                chart.draw_series([middle]).expect(SVG);
            }
            let colour = if row.is_reference { REFERENCE } else { OWN };
            let Some([from, middle, to]) = marks[i] else { continue };
            if self.bars {
                let start = if self.x.log { low } else { 0.0 };
                chart.draw_series([Rectangle::new([(start, y - 0.28), (middle, y + 0.28)], colour.mix(0.6).filled())]).expect(SVG);
            } else {
                chart.draw_series([Circle::new((middle, y), 4, colour.filled())]).expect(SVG);
            }
            if row.half_width.is_some() {
                let ends = [(from, from), (to, to)].map(|(x, _)| PathElement::new([(x, y - 0.15), (x, y + 0.15)], colour.stroke_width(2)));
                chart.draw_series(ends).expect(SVG);
                chart.draw_series([PathElement::new([(from, y), (to, y)], colour.stroke_width(2))]).expect(SVG);
            }
        }
        for (s, source) in self.sources.iter().enumerate() {
            let colour = COLOURS[(3 + s) % COLOURS.len()];
            let of = |(i, row): (usize, &Mark)| row.others.iter().filter(|o| o.0 == s).map(move |o| (i, o.1, o.2)).collect::<Vec<_>>();
            let points: Vec<(usize, f64, Option<f64>)> = self.rows.iter().enumerate().flat_map(of).collect();
            for (i, value, half) in &points {
                let y = (n - 1 - i) as f64 - 0.25;
                let Some([from, _, to]) = self.interval(*value, *half) else { continue };
                chart.draw_series([PathElement::new([(from, y), (to, y)], colour.stroke_width(1))]).expect(SVG);
            }
            let crosses = points
                .iter()
                .filter_map(|(i, v, _)| Some(Cross::new((place(&self.x, *v)?, (n - 1 - i) as f64 - 0.25), 4, colour.stroke_width(2))));
            chart
                .draw_series(crosses.collect::<Vec<_>>())
                .expect(SVG)
                .label(source)
                .legend(move |(x, y)| Cross::new((x + 9, y), 4, colour.stroke_width(2)));
        }
        if !self.sources.is_empty() {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(200, 200, 200))
                .label_font(("sans-serif", 12))
                .draw()
                .expect(SVG);
        }
    }
}

/// A row in the plane of time and error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Name.
    pub label: String,
    /// Place.
    pub at: (f64, f64),
    /// True if nothing beats it.
    pub front: bool,
}

/// Rows of a study by what they cost and how wrong they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Line above the diagram.
    pub title: String,
    /// What is paid.
    pub x: Axis,
    /// What is missed.
    pub y: Axis,
    /// Rows; those without a place on the axes are left out.
    pub points: Vec<Point>,
    /// Costs of references, which have no error: name and place.
    pub lines: Vec<(String, f64)>,
}

/// Points above which only those of the front have names.
const NAMED: usize = 25;

impl Scatter {
    /// The diagram as SVG.
    pub fn svg(&self, size: (u32, u32)) -> String {
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            root.fill(&WHITE).expect(SVG);
            self.draw(&root);
            root.present().expect(SVG);
        }
        svg
    }

    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>) {
        let points: Vec<(&Point, (f64, f64))> =
            self.points.iter().filter_map(|p| Some((p, (place(&self.x, p.at.0)?, place(&self.y, p.at.1)?)))).collect();
        let lines: Vec<(&str, f64)> = self.lines.iter().filter_map(|l| Some((l.0.as_str(), place(&self.x, l.1)?))).collect();
        let x = range(points.iter().map(|p| p.1.0).chain(lines.iter().map(|l| l.1)), self.x.log, 0.12);
        let y = range(points.iter().map(|p| p.1.1), self.y.log, 0.12);
        let mut builder = ChartBuilder::on(area);
        builder.margin(12).margin_right(24).x_label_area_size(44).y_label_area_size(82);
        if !self.title.is_empty() {
            builder.caption(&self.title, ("sans-serif", 17));
        }
        let mut chart = builder.build_cartesian_2d(Scale::new(x, self.x.log), Scale::new(y, self.y.log)).expect(SVG);
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .max_light_lines(0)
            .bold_line_style(RGBColor(225, 225, 225))
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 15))
            .draw()
            .expect(SVG);
        // The front as steps: what error is had for at most this time.
        let mut front: Vec<(f64, f64)> = points.iter().filter(|p| p.0.front).map(|p| p.1).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let steps: Vec<(f64, f64)> = front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(front.last().copied()).collect();
        chart.draw_series([PathElement::new(steps, FRONT.stroke_width(1))]).expect(SVG);
        let style = |right: bool| {
            let pos = Pos::new(if right { HPos::Left } else { HPos::Right }, VPos::Center);
            TextStyle::from(("sans-serif", 12).into_font()).pos(pos)
        };
        for (name, at) in lines {
            chart.draw_series([PathElement::new([(at, y.0), (at, y.1)], REFERENCE.stroke_width(2))]).expect(SVG);
            let right = at < 0.5 * (x.0 + x.1);
            let text =
                EmptyElement::at((at, y.1)) + Text::new(name.to_owned(), (if right { 6 } else { -6 }, 10), style(right).color(&REFERENCE));
            chart.draw_series([text]).expect(SVG);
        }
        let all = points.len() <= NAMED;
        for (point, at) in points {
            let colour = if point.front { FRONT } else { OWN };
            let right = at.0 < x.0 + 0.6 * (x.1 - x.0);
            let label = if all || point.front { point.label.clone() } else { String::new() };
            let mark = EmptyElement::at(at)
                + Circle::new((0, 0), if point.front { 5 } else { 4 }, colour.filled())
                + Text::new(label, (if right { 9 } else { -9 }, 0), style(right));
            chart.draw_series([mark]).expect(SVG);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(rows: Vec<Mark>, log: bool, bars: bool) -> String {
        let x = if log { Axis::log("wall time [s]") } else { Axis::linear("length [mm]") };
        RowChart { title: "Braid".into(), x, rows, bars, sources: vec!["paper".into()] }.svg(700)
    }

    #[test]
    fn rows_values_and_sources_are_in_the_picture() {
        let mark = |label: &str, value| Mark {
            label: label.into(),
            value,
            half_width: Some(0.5),
            band: Some((3.6, 3.7)),
            others: vec![(0, 3.5, None)],
            ..Default::default()
        };
        let rows = vec![mark("7 trusses", Some(3.6)), mark("7 beams & <b>", Some(0.2)), mark("failed", None)];
        for (log, bars) in [(false, false), (false, true), (true, true), (true, false)] {
            let svg = chart(rows.clone(), log, bars);
            for text in ["7 trusses", "7 beams &amp; &lt;b&gt;", "failed", "paper", "Braid"] {
                assert!(svg.contains(text), "{text} is missing");
            }
            assert!(!svg.contains("NaN") && !svg.contains("inf"));
        }
        assert!(chart(Vec::new(), true, true).contains("</svg>"));
    }

    #[test]
    fn the_front_is_drawn_in_its_colour() {
        let point = |label: &str, at, front| Point { label: label.into(), at, front };
        let points = vec![
            point("fast", (1.0, 0.5), true),
            point("good", (50.0, 0.1), true),
            point("bad", (80.0, 0.7), false),
            point("zero", (1.0, 0.0), true),
        ];
        let lines = vec![("reference".to_owned(), 1000.0)];
        let scatter = Scatter { title: String::new(), x: Axis::log("time [s]"), y: Axis::log("error [-]"), points, lines };
        let svg = scatter.svg((600, 400));
        for text in ["fast", "good", "bad", "reference"] {
            assert!(svg.contains(&format!("{text}\n")), "{text} is missing in\n{svg}");
        }
        assert!(!svg.contains("zero"), "a decadic axis has no place for it");
        assert_eq!(svg.matches("<circle").count(), 3);
        let empty = Scatter { points: Vec::new(), lines: Vec::new(), ..scatter };
        assert!(empty.svg((300, 200)).contains("</svg>"));
    }
}
