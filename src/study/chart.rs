//! A line per row with its value and interval.
use crate::output::plot::{Area, Axis, COLOURS, SVG, Scale, range};
use plotters::prelude::*;

/// A row of a [`RowChart`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mark {
    /// Name.
    pub label: String,
    /// Value; nothing is drawn without one.
    pub value: Option<f64>,
    /// Half width of its interval.
    pub half_width: Option<f64>,
    /// Interval of the reference, drawn behind: about its value, of errors from zero to what cannot be told from none.
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

/// Colours of rows, of the reference, and of rows that nothing beats.
pub(super) const OWN: RGBColor = COLOURS[0];
pub(super) const REFERENCE: RGBColor = COLOURS[2];
pub(super) const FRONT: RGBColor = COLOURS[1];
/// Width of a character of the labels and height of a row, in pixels.
const CHARACTER: u32 = 9;
const HEIGHT: u32 = 30;

/// Place on an axis; none where it has none.
pub(super) fn place(axis: &Axis, v: f64) -> Option<f64> {
    let p = if axis.log { v.log10() } else { v };
    p.is_finite().then_some(p)
}

impl RowChart {
    /// The diagram as SVG, `width` pixels wide.
    pub fn svg(&self, width: u32) -> String {
        let longest = self.rows.iter().map(|r| r.label.chars().count()).max().unwrap_or(0) as u32;
        let size = (width, (f64::from(HEIGHT) * (self.rows.len().max(1) as f64 + self.legend())) as u32 + 90);
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            root.fill(&WHITE).expect(SVG);
            self.draw(&root, (CHARACTER * longest + 20).min(width / 2));
            root.present().expect(SVG);
        }
        svg
    }

    /// Height of the legend in rows; it stands above them.
    fn legend(&self) -> f64 {
        if self.sources.is_empty() { 0.0 } else { 0.4 + 0.7 * self.sources.len() as f64 }
    }

    /// Middle and ends of an interval on the axis; a lower end without a place is the middle.
    fn interval(&self, value: f64, half: Option<f64>) -> Option<[f64; 3]> {
        let middle = place(&self.x, value)?;
        let half = half.unwrap_or(0.0);
        // What is drawn as a bar has no side below zero.
        let least = if self.bars { 0.0f64.min(value) } else { f64::NEG_INFINITY };
        let ends = [(value - half).max(least), value + half].map(|v| place(&self.x, v).unwrap_or(middle));
        Some([ends[0], middle, ends[1]])
    }

    fn draw(&self, area: &Area<'_>, labels: u32) {
        let n = self.rows.len();
        let marks: Vec<Option<[f64; 3]>> = self.rows.iter().map(|r| self.interval(r.value?, r.half_width)).collect();
        let others = self.rows.iter().flat_map(|r| &r.others).filter_map(|o| self.interval(o.1, o.2)).flatten();
        let bands = self.rows.iter().filter_map(|r| r.band).flat_map(|b| [b.0, b.1]).filter_map(|v| place(&self.x, v));
        let zero = (self.bars && !self.x.log).then_some(0.0);
        let all: Vec<f64> = marks.iter().flatten().flatten().copied().chain(others).chain(bands).chain(zero).collect();
        let (mut low, high) = range(all.iter().copied(), self.x.log, 0.05);
        // Bars stand on zero, without air below it.
        if zero.is_some() && all.iter().all(|v| *v >= 0.0) {
            low = 0.0;
        }
        let mut builder = ChartBuilder::on(area);
        builder.margin(10).margin_right(28).x_label_area_size(42).y_label_area_size(labels);
        if !self.title.is_empty() {
            builder.caption(&self.title, ("sans-serif", 17));
        }
        let mut chart = builder.build_cartesian_2d(Scale::new((low, high), self.x.log), Scale::counted(n, self.legend())).expect(SVG);
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
                // An error has a largest value that means nothing, and none in the middle.
                if !self.bars {
                    let middle = PathElement::new([(0.5 * (a + b), y - 0.5), (0.5 * (a + b), y + 0.5)], REFERENCE.stroke_width(1));
                    chart.draw_series([middle]).expect(SVG);
                }
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
}
