//! Error against time: what a row costs and how wrong it is.
use super::chart::{FRONT, OWN, REFERENCE, place};
use crate::output::plot::{Area, Axis, SVG, frame, range};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

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
    /// Error that cannot be told from none.
    pub floor: Option<f64>,
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

    fn draw(&self, area: &Area<'_>) {
        let points: Vec<(&Point, (f64, f64))> =
            self.points.iter().filter_map(|p| Some((p, (place(&self.x, p.at.0)?, place(&self.y, p.at.1)?)))).collect();
        let lines: Vec<(&str, f64)> = self.lines.iter().filter_map(|l| Some((l.0.as_str(), place(&self.x, l.1)?))).collect();
        let x = range(points.iter().map(|p| p.1.0).chain(lines.iter().map(|l| l.1)), self.x.log, 0.12);
        let floor = self.floor.and_then(|f| place(&self.y, f));
        let y = range(points.iter().map(|p| p.1.1).chain(floor), self.y.log, 0.12);
        let mut chart = frame(area, &self.title, (&self.x, x), (&self.y, y));
        if let Some(floor) = floor {
            chart.draw_series([Rectangle::new([(x.0, y.0), (x.1, floor)], REFERENCE.mix(0.12).filled())]).expect(SVG);
            let style = TextStyle::from(("sans-serif", 12).into_font()).pos(Pos::new(HPos::Left, VPos::Top)).color(&REFERENCE);
            chart.draw_series([EmptyElement::at((x.0, floor)) + Text::new("not known of the reference", (6, 4), style)]).expect(SVG);
        }
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
        let scatter =
            Scatter { title: String::new(), x: Axis::log("time [s]"), y: Axis::log("error [-]"), points, lines, floor: Some(0.07) };
        let svg = scatter.svg((600, 400));
        for text in ["fast", "good", "bad", "reference", "not known of the reference"] {
            assert!(svg.contains(&format!("{text}\n")), "{text} is missing in\n{svg}");
        }
        assert!(!svg.contains("zero"), "a decadic axis has no place for it");
        assert_eq!(svg.matches("<circle").count(), 3);
        let empty = Scatter { points: Vec::new(), lines: Vec::new(), ..scatter };
        assert!(empty.svg((300, 200)).contains("</svg>"));
    }
}
