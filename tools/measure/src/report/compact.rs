//! Shorter SVG of a plot, a third of the length: the plotting library writes a full element for each dash, tick and
//! mark.
//!
//! Consecutive shapes of one style become one path. Attributes with initial values are removed; fonts are those of the
//! page. Unknown elements stay unchanged. The picture is the same.

use std::fmt::Write;

/// One element without content, or a text element with its text.
struct Element<'a> {
    name: &'a str,
    attributes: Vec<(&'a str, &'a str)>,
    text: &'a str,
}

impl<'a> Element<'a> {
    fn get(&self, name: &str) -> &'a str {
        self.attributes.iter().find(|(n, _)| *n == name).map_or("", |(_, value)| value)
    }

    /// Numbers of an attribute, separated by commas or spaces; integers, as the plotting library writes them.
    fn numbers(&self, name: &str) -> Option<Vec<i32>> {
        let words = self.get(name).split([',', ' ']).filter(|word| !word.is_empty());
        words.map(|word| word.parse().ok()).collect()
    }

    fn number(&self, name: &str) -> Option<i32> {
        self.get(name).parse().ok()
    }

    /// Outline as path data.
    fn path(&self) -> Option<String> {
        Some(match self.name {
            "line" => joined(&[self.number("x1")?, self.number("y1")?, self.number("x2")?, self.number("y2")?])?,
            "polyline" => joined(&self.numbers("points")?)?,
            "polygon" => joined(&self.numbers("points")?)? + "z",
            "rect" => {
                let [x, y, w, h] = ["x", "y", "width", "height"].map(|name| self.number(name));
                format!("M{} {}h{}v{}h{}z", x?, y?, w?, h?, -w?)
            }
            "circle" => {
                let [x, y, r] = ["cx", "cy", "r"].map(|name| self.number(name));
                format!("M{} {}a{2} {2} 0 1 0 {3} 0a{2} {2} 0 1 0 {4} 0", x? - r?, y?, r?, 2 * r?, -2 * r?)
            }
            _ => return None,
        })
    }

    /// Attributes of the paint style, without those that have initial values.
    fn style(&self) -> String {
        let mut style = String::new();
        for name in ["fill", "stroke", "stroke-width", "opacity"] {
            let value = self.get(name);
            let is_open = matches!(self.name, "line" | "polyline");
            let value = if name == "fill" && value.is_empty() && is_open { "none" } else { value };
            let initial = match name {
                "fill" => "#000000",
                "stroke" => "none",
                _ => "1",
            };
            if !value.is_empty() && value != initial {
                let _ = write!(style, " {name}=\"{value}\"");
            }
        }
        style
    }

    fn label(&self) -> String {
        let mut html = String::from("<text");
        for (name, value) in &self.attributes {
            let is_initial = matches!(
                (*name, *value),
                ("opacity", "1") | ("fill", "#000000") | ("text-anchor", "start") | ("font-family", _)
            );
            match *name {
                _ if is_initial => {}
                "font-size" => {
                    let size = value.parse::<f64>().map_or_else(|_| (*value).into(), |size| format!("{size:.1}"));
                    let _ = write!(html, " {name}=\"{size}\"");
                }
                _ => {
                    let _ = write!(html, " {name}=\"{value}\"");
                }
            }
        }
        html + ">" + self.text.trim() + "</text>"
    }
}

/// Path of lines from point to point; horizontal lines in their short form.
fn joined(numbers: &[i32]) -> Option<String> {
    let (&[x, y], rest) = numbers.as_chunks::<2>().0.split_first()?;
    let mut path = format!("M{x} {y}");
    let (mut from, mut is_line) = ([x, y], false);
    for &to in rest {
        if to[1] == from[1] {
            let _ = write!(path, "h{}", to[0] - from[0]);
            is_line = false;
        } else if to[0] == from[0] {
            let _ = write!(path, "v{}", to[1] - from[1]);
            is_line = false;
        } else {
            let _ = write!(path, "{}{} {}", if is_line { " " } else { "L" }, to[0], to[1]);
            is_line = true;
        }
        from = to;
    }
    Some(path)
}

/// The same picture as a shorter SVG.
#[must_use]
pub fn compact(svg: &str) -> String {
    let mut out = String::with_capacity(svg.len() / 2);
    let (mut style, mut path) = (String::new(), String::new());
    let mut rest = svg;
    while let Some(begin) = rest.find('<') {
        let Some(length) = rest[begin..].find('>') else { break };
        let tag = &rest[begin..=begin + length];
        rest = &rest[begin + length + 1..];
        let element = parse(tag, rest);
        let drawn = element.as_ref().and_then(Element::path);
        if let (Some(element), Some(drawn)) = (&element, &drawn) {
            let new = element.style();
            if new != style {
                flush(&mut out, &style, &mut path);
                style = new;
            }
            path += drawn;
            continue;
        }
        flush(&mut out, &style, &mut path);
        match element {
            Some(element) if element.name == "text" => {
                out += &element.label();
                rest = &rest[rest.find("</text>").map_or(rest.len(), |end| end + "</text>".len())..];
            }
            _ => out += tag,
        }
    }
    flush(&mut out, &style, &mut path);
    out
}

fn flush(out: &mut String, style: &str, path: &mut String) {
    if !path.is_empty() {
        let _ = write!(out, "<path{style} d=\"{path}\"/>");
        path.clear();
    }
}

/// An element without content, or a text element with the text that follows its tag.
fn parse<'a>(tag: &'a str, behind: &'a str) -> Option<Element<'a>> {
    let inside = tag.strip_prefix('<')?.strip_suffix('>')?;
    let (name, mut rest) = inside.split_once(' ')?;
    if name != "text" && !inside.ends_with('/') {
        return None;
    }
    let mut attributes = Vec::new();
    while let Some((attribute, behind)) = rest.split_once("=\"") {
        let (value, behind) = behind.split_once('"')?;
        attributes.push((attribute.trim(), value));
        rest = behind;
    }
    let text = if name == "text" { behind.split_once("</text>")?.0 } else { "" };
    Some(Element { name, attributes, text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_of_one_style_become_one_path() {
        let svg = "<svg viewBox=\"0 0 9 9\">\n\
            <polyline fill=\"none\" opacity=\"1\" stroke=\"#D55E00\" stroke-width=\"1\" points=\"60,2 67,2 \"/>\n\
            <polyline fill=\"none\" opacity=\"1\" stroke=\"#D55E00\" stroke-width=\"1\" points=\"71,2 78,5 79,9 79,1 \"/>\n\
            <line opacity=\"0.5\" stroke=\"#000000\" stroke-width=\"2\" x1=\"8\" y1=\"4\" x2=\"8\" y2=\"3\"/>\n\
            <rect x=\"1\" y=\"2\" width=\"8\" height=\"7\" opacity=\"1\" fill=\"#E69F00\" stroke=\"none\"/>\n\
            <polygon opacity=\"1\" fill=\"#E69F00\" points=\"1,6 5,8 \"/>\n\
            <circle cx=\"9\" cy=\"8\" r=\"4\" opacity=\"1\" fill=\"#000000\" stroke=\"none\" stroke-width=\"1\"/>\n\
            <circle cx=\"9\" cy=\"8\" r=\"4\" opacity=\"1\" fill=\"none\" stroke=\"#000000\" stroke-width=\"2\"/>\n\
            <text x=\"1\" dy=\"0.5ex\" text-anchor=\"end\" font-family=\"sans-serif\" font-size=\"10.48387\" opacity=\"1\" \
            fill=\"#000000\">\n0.1 &lt;\n</text>\n</svg>\n";
        let expected = "<svg viewBox=\"0 0 9 9\">\
            <path fill=\"none\" stroke=\"#D55E00\" d=\"M60 2h7M71 2L78 5 79 9v-8\"/>\
            <path fill=\"none\" stroke=\"#000000\" stroke-width=\"2\" opacity=\"0.5\" d=\"M8 4v-1\"/>\
            <path fill=\"#E69F00\" d=\"M1 2h8v7h-8zM1 6L5 8z\"/>\
            <path d=\"M5 8a4 4 0 1 0 8 0a4 4 0 1 0 -8 0\"/>\
            <path fill=\"none\" stroke=\"#000000\" stroke-width=\"2\" d=\"M5 8a4 4 0 1 0 8 0a4 4 0 1 0 -8 0\"/>\
            <text x=\"1\" dy=\"0.5ex\" text-anchor=\"end\" font-size=\"10.5\">0.1 &lt;</text></svg>";
        assert_eq!(compact(svg), expected);
    }

    #[test]
    fn what_is_not_known_stays() {
        let svg = "<svg><g id=\"a\"><image href=\"b\"/><circle cx=\"0.5\" cy=\"1\" r=\"2\"/></g></svg>";
        assert_eq!(compact(svg), svg);
    }
}
