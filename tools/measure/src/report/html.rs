//! Parts of a page: escaped text, tables, figures, and the page itself.
//!
//! Each page is one file: style and pictures are inside; there are no scripts and no external resources.

use std::fmt::Write;

use supervol_format::cast::{narrow, whole};

use super::machine::Circumstances;

/// One section of a page.
#[derive(Debug)]
pub struct Section {
    /// Anchor, unique in its page.
    pub id: String,
    /// Title, plain text.
    pub title: String,
    /// HTML.
    pub body: String,
}

impl Section {
    /// A section; `title` is plain text, `body` is HTML.
    #[must_use]
    pub fn new(id: &str, title: &str, body: String) -> Self {
        Self { id: id.into(), title: title.into(), body }
    }
}

/// Text escaped for HTML.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut html = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            '"' => html.push_str("&quot;"),
            '\'' => html.push_str("&#39;"),
            _ => html.push(c),
        }
    }
    html
}

/// A paragraph of plain text.
#[must_use]
pub fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escape(text))
}

/// A figure: `content` is HTML (an SVG or pictures); `title` and `reading` are plain text.
#[must_use]
pub fn figure(title: &str, content: &str, reading: &str) -> String {
    format!(
        "<figure><figcaption class=\"title\">{}</figcaption>{content}<figcaption>{}</figcaption></figure>\n",
        escape(title),
        escape(reading)
    )
}

/// Figures in a grid, side by side if the page is wide enough.
#[must_use]
pub fn grid(figures: &[String]) -> String {
    format!("<div class=\"grid\">{}</div>\n", figures.concat())
}

/// A table: cells are HTML, headings are plain text. Cells that begin with a digit, a sign or a dash are right-aligned.
#[must_use]
pub fn table(headings: &[&str], rows: &[Vec<String>]) -> String {
    let mut html = String::from("<div class=\"wide\"><table><thead><tr>");
    for heading in headings {
        let _ = write!(html, "<th>{}</th>", escape(heading));
    }
    html.push_str("</tr></thead><tbody>\n");
    for row in rows {
        html.push_str("<tr>");
        for cell in row {
            let begins = cell.starts_with(|c: char| c.is_ascii_digit() || ['-', '+', '\u{2013}'].contains(&c));
            // A number, perhaps with spread or unit, but not a sentence that begins with a number.
            let is_number = begins && cell.split_whitespace().count() <= 3;
            let _ = write!(html, "<td{}>{cell}</td>", if is_number { " class=\"n\"" } else { "" });
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody></table></div>\n");
    html
}

/// A section that opens on a click.
#[must_use]
pub fn details(summary: &str, content: &str) -> String {
    format!("<details><summary>{}</summary>{content}</details>\n", escape(summary))
}

/// PASS in green.
pub const PASS: &str = "<b class=\"pass\">PASS</b>";
/// FAIL in red.
pub const FAIL: &str = "<b class=\"fail\">FAIL</b>";

/// A number with three significant digits.
#[must_use]
pub fn number(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        return if value.is_nan() {
            "not a number".into()
        } else if value > 0.0 {
            "∞".into()
        } else {
            "−∞".into()
        };
    }
    if size == 0.0 {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let decimals = (2 - whole::<i32>(size.log10().floor())).clamp(0, 6);
    let text = format!("{value:.0$}", narrow::<usize>(decimals));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// [`number`], or a dash for `None`.
#[must_use]
pub fn number_or_dash(value: Option<f64>) -> String {
    value.map_or_else(|| "\u{2013}".into(), number)
}

/// A size in bytes, with a binary unit.
#[must_use]
pub fn bytes(count: u64) -> String {
    match count {
        0..1_024 => format!("{count} B"),
        1_024..1_048_576 => format!("{:.0} KiB", count as f64 / 1_024.0),
        _ => format!("{:.1} MiB", count as f64 / 1_048_576.0),
    }
}

/// Machine, date and command as a section.
#[must_use]
pub fn circumstances(here: &Circumstances) -> Section {
    let memory = here.memory_gib.map_or_else(|| "unknown".into(), |gib| format!("{gib:.1} GiB"));
    let rows = [
        ("Command", format!("<code>{}</code>", escape(&here.command))),
        ("Date (UTC)", escape(&here.date)),
        ("Processor", escape(&format!("{}, {} in use", here.processor, here.processors))),
        ("Memory", memory),
        ("System", escape(&here.system)),
        ("Program", escape(&here.version)),
    ];
    let rows = rows.map(|(name, value)| format!("<tr><th>{name}</th><td>{value}</td></tr>"));
    Section::new("machine", "Machine and command", format!("<table class=\"facts\">{}</table>\n", rows.concat()))
}

/// The whole page: title, summary (HTML), contents, sections.
#[must_use]
pub fn page(title: &str, summary: &str, sections: &[Section]) -> String {
    let mut contents = String::new();
    let mut body = String::new();
    for (i, section) in sections.iter().enumerate() {
        let (id, title, number) = (escape(&section.id), escape(&section.title), i + 1);
        let _ = writeln!(contents, "<li><a href=\"#{id}\">{title}</a></li>");
        let _ = writeln!(body, "<section id=\"{id}\"><h2>{number}. {title}</h2>\n{}</section>", section.body);
    }
    let title = escape(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width, initial-scale=1\"><title>{title}</title>\n<style>{STYLE}</style></head>\n<body>\n\
         <h1>{title}</h1>\n{summary}\n<nav><h2>Contents</h2><ol>\n{contents}</ol></nav>\n{body}</body></html>\n"
    )
}

const STYLE: &str = include_str!("report.css");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        assert_eq!(escape("a<b> & \"c\" 'd'"), "a&lt;b&gt; &amp; &quot;c&quot; &#39;d&#39;");
        let html = figure("<script>", "<svg/>", "x & y");
        assert!(!html.contains("<script>") && html.contains("<svg/>") && html.contains("x &amp; y"));
        let html = page("<t>", "", &[Section::new("a\"b", "<s>", String::new())]);
        assert!(!html.contains("<t>") && !html.contains("<s>") && html.contains("#a&quot;b"));
    }

    #[test]
    fn numbers_have_three_digits() {
        let cases = [(0.0, "0"), (1234.6, "1235"), (12.0, "12"), (1.2345, "1.23"), (0.00123456, "0.00123")];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
        assert_eq!(number(1.5e-7), "1.50e-7");
        assert_eq!(number(-2.5), "-2.5");
        assert_eq!((number(f64::INFINITY), number_or_dash(None)), ("∞".into(), "–".into()));
        assert_eq!((bytes(12), bytes(2048), bytes(3 << 20)), ("12 B".into(), "2 KiB".into(), "3.0 MiB".into()));
    }
}
