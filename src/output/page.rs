//! Pages that need nothing but themselves: one look for all of them, on a screen or on paper.
use crate::study::text::escape;

const STYLE: &str = "
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 66rem; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2rem; border-bottom: 1px solid #ccc; }
p.about { color: #666; margin-top: 0.2rem; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.87rem; }
th, td { padding: 0.25rem 0.6rem; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td.text { white-space: normal; }
tr.reference td { background: #e8f5ef; } tr.others td { color: #777; font-style: italic; border-bottom-style: dotted; }
small { color: #666; } td.front { color: #b34700; font-weight: 600; } td.failed { color: #b00020; }
figure { margin: 0.8rem 0; break-inside: avoid; } svg { max-width: 100%; height: auto; }
div.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(18rem, 1fr)); gap: 0.8rem; } div.pictures img { max-width: 100%; height: auto; }
figcaption { text-align: center; color: #444; } p.none { color: #777; font-style: italic; text-align: center; }
pre { background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 0.8rem; white-space: pre-wrap; }
@page { margin: 14mm; }
@media print { html { font-size: 11px; } body { margin: 0; padding: 0; max-width: none; font-size: 11px; } div.wide { overflow: visible; } th, td { white-space: normal; padding: 0.15rem 0.3rem; } tr { break-inside: avoid; } h2 { break-after: avoid; } }
";

/// The beginning of a page, up to its heading; `author` is who has written it.
pub(crate) fn head(title: &str, author: &str) -> String {
    let (t, author) = (escape(title), escape(author));
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <meta name=\"generator\" content=\"{author}\">\n<title>{t}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{t}</h1>\n"
    )
}

/// The end of a page.
pub(crate) const END: &str = "</body>\n</html>\n";

/// Inside a page SVG needs no name space, and with it no address.
pub(crate) fn inline(svg: &str) -> String {
    svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::chart::{Mark, RowChart};

    #[test]
    fn pictures_inside_the_page_have_no_address() {
        let x = crate::output::plot::Axis::linear("x");
        let chart = RowChart { title: "a".into(), x, rows: vec![Mark::default()], bars: false, sources: Vec::new() };
        let svg = chart.svg(300);
        assert!(svg.contains("http"), "a file of its own needs the name space");
        assert!(!inline(&svg).contains("http"));
    }
}
