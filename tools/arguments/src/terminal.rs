//! Standard output and standard error, without control characters.
//!
//! Units, notes, names and keys come from files of unknown origin. Control characters could control the terminal.
//! They are shown as `\u001b`, except line ends and tabulators; so are characters that change the writing direction.
//! JSON with such characters stays the same JSON.

use std::io::{self, IsTerminal, StderrLock, StdoutLock, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// True if only results, warnings and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Form of the results on standard output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text for people.
    Text,
    /// JSON for programs.
    Json,
}

/// Stream that escapes control characters.
#[derive(Debug)]
pub struct Clean<W>(W);

/// Restricts the output to results, warnings and errors.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// True after [`be_quiet`].
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Standard output for remarks beside the result; discards them if the output is quiet.
pub fn remarks() -> Box<dyn Write> {
    if is_quiet() { Box::new(io::sink()) } else { Box::new(stdout()) }
}

/// True if standard output and standard error are a terminal.
pub fn is_at_terminal() -> bool {
    io::stdout().is_terminal() && io::stderr().is_terminal()
}

/// Standard output.
pub fn stdout() -> Clean<StdoutLock<'static>> {
    Clean(io::stdout().lock())
}

/// Standard error.
pub fn stderr() -> Clean<StderrLock<'static>> {
    Clean(io::stderr().lock())
}

impl<W: Write> Write for Clean<W> {
    /// Formatted text arrives in whole characters; bytes that are not UTF-8 become replacement characters.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        if text.contains(is_unsafe) {
            self.0.write_all(cleaned(&text).as_bytes())?;
        } else {
            self.0.write_all(text.as_bytes())?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

fn is_unsafe(c: char) -> bool {
    (c.is_control() && c != '\n' && c != '\t') || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn cleaned(text: &str) -> String {
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_unsafe(c) { shown += &format!("\\u{:04x}", u32::from(c)) } else { shown.push(c) }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_to_a_terminal_are_shown_and_json_stays_the_same() {
        let mut out = Clean(Vec::new());
        let unit = "HU\u{1b}[2J\u{9b}2J\u{202e}\u{7f}";
        write!(out, "a\tb\n{unit} ä\r").expect("memory takes everything");
        assert_eq!(out.0, "a\tb\nHU\\u001b[2J\\u009b2J\\u202e\\u007f ä\\u000d".as_bytes());

        let mut out = Clean(Vec::new());
        write!(out, "{}", serde_json::json!({ "unit": unit })).expect("memory takes everything");
        let back: serde_json::Value = serde_json::from_slice(&out.0).expect("still JSON");
        assert_eq!(back["unit"], unit);
        assert!(out.0.iter().all(|b| (b' '..0x7f).contains(b)));
    }
}
