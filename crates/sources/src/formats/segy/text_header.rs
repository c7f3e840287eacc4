//! The 3200-byte text headers: EBCDIC or ASCII, 40 lines of 80 characters.
//!
//! The standard asks for EBCDIC (code page 037, IBM 1990) and, since revision 2, allows ASCII; files use either at any
//! revision, so the encoding is judged from the bytes. Extended text headers are only looked at for the stanza that
//! ends them.

/// Bytes of one text header.
pub const TEXT_BYTES: usize = 3200;

/// Columns of a line: the header is a deck of 40 punched cards.
const COLUMNS: usize = 80;

/// Unicode code point (all below 256) of each code page 037 byte.
#[rustfmt::skip]
const CP037: [u8; 256] = [
    0x00, 0x01, 0x02, 0x03, 0x9C, 0x09, 0x86, 0x7F, 0x97, 0x8D, 0x8E, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F,
    0x10, 0x11, 0x12, 0x13, 0x9D, 0x85, 0x08, 0x87, 0x18, 0x19, 0x92, 0x8F, 0x1C, 0x1D, 0x1E, 0x1F,
    0x80, 0x81, 0x82, 0x83, 0x84, 0x0A, 0x17, 0x1B, 0x88, 0x89, 0x8A, 0x8B, 0x8C, 0x05, 0x06, 0x07,
    0x90, 0x91, 0x16, 0x93, 0x94, 0x95, 0x96, 0x04, 0x98, 0x99, 0x9A, 0x9B, 0x14, 0x15, 0x9E, 0x1A,
    0x20, 0xA0, 0xE2, 0xE4, 0xE0, 0xE1, 0xE3, 0xE5, 0xE7, 0xF1, 0xA2, 0x2E, 0x3C, 0x28, 0x2B, 0x7C,
    0x26, 0xE9, 0xEA, 0xEB, 0xE8, 0xED, 0xEE, 0xEF, 0xEC, 0xDF, 0x21, 0x24, 0x2A, 0x29, 0x3B, 0xAC,
    0x2D, 0x2F, 0xC2, 0xC4, 0xC0, 0xC1, 0xC3, 0xC5, 0xC7, 0xD1, 0xA6, 0x2C, 0x25, 0x5F, 0x3E, 0x3F,
    0xF8, 0xC9, 0xCA, 0xCB, 0xC8, 0xCD, 0xCE, 0xCF, 0xCC, 0x60, 0x3A, 0x23, 0x40, 0x27, 0x3D, 0x22,
    0xD8, 0x61, 0x62, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0xAB, 0xBB, 0xF0, 0xFD, 0xFE, 0xB1,
    0xB0, 0x6A, 0x6B, 0x6C, 0x6D, 0x6E, 0x6F, 0x70, 0x71, 0x72, 0xAA, 0xBA, 0xE6, 0xB8, 0xC6, 0xA4,
    0xB5, 0x7E, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A, 0xA1, 0xBF, 0xD0, 0xDD, 0xDE, 0xAE,
    0x5E, 0xA3, 0xA5, 0xB7, 0xA9, 0xA7, 0xB6, 0xBC, 0xBD, 0xBE, 0x5B, 0x5D, 0xAF, 0xA8, 0xB4, 0xD7,
    0x7B, 0x41, 0x42, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0xAD, 0xF4, 0xF6, 0xF2, 0xF3, 0xF5,
    0x7D, 0x4A, 0x4B, 0x4C, 0x4D, 0x4E, 0x4F, 0x50, 0x51, 0x52, 0xB9, 0xFB, 0xFC, 0xF9, 0xFA, 0xFF,
    0x5C, 0xF7, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5A, 0xB2, 0xD4, 0xD6, 0xD2, 0xD3, 0xD5,
    0x30, 0x31, 0x32, 0x33, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0xB3, 0xDB, 0xDC, 0xD9, 0xDA, 0x9F,
];

/// Character set of a text header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ebcdic,
    Ascii,
}

/// The encoding under which more bytes are letters, digits and spaces; EBCDIC where neither wins.
pub(super) fn detect(bytes: &[u8]) -> Encoding {
    let plain = |c: u8| c == b' ' || c.is_ascii_alphanumeric();
    let ascii = bytes.iter().filter(|&&b| plain(b)).count();
    let ebcdic = bytes.iter().filter(|&&b| plain(CP037[usize::from(b)])).count();
    if ascii > ebcdic { Encoding::Ascii } else { Encoding::Ebcdic }
}

/// A text in EBCDIC, one byte for each character; those that it does not have become blanks.
pub fn encode(text: &str) -> Vec<u8> {
    let code = |c: char| {
        let latin = u8::try_from(u32::from(c)).ok().filter(|_| !c.is_control());
        latin.and_then(|latin| (0..=u8::MAX).find(|at| CP037[usize::from(*at)] == latin)).unwrap_or(0x40)
    };
    text.chars().map(code).collect()
}

/// The header as text: lines of 80 characters, trailing blanks cut, control characters shown as blanks.
pub(super) fn decode(bytes: &[u8], encoding: Encoding) -> String {
    let character = |&b: &u8| {
        let code = if encoding == Encoding::Ebcdic { CP037[usize::from(b)] } else { b };
        let c = char::from(code);
        if c.is_control() { ' ' } else { c }
    };
    let lines = bytes.chunks(COLUMNS).map(|line| {
        let text: String = line.iter().map(character).collect();
        text.trim_end().to_owned()
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Whether an extended text header begins with the stanza `((SEG: EndText))`, spaces and case ignored.
pub(super) fn is_end_stanza(bytes: &[u8]) -> bool {
    [Encoding::Ebcdic, Encoding::Ascii].into_iter().any(|encoding| {
        let text = decode(&bytes[..bytes.len().min(2 * COLUMNS)], encoding);
        let compact: String = text.chars().filter(|c| !c.is_whitespace()).flat_map(char::to_lowercase).collect();
        compact.starts_with("((seg:endtext))")
    })
}

/// Whether the text says that samples are spaced in depth, in so many words.
///
/// No binary field says it. Anything short of these phrases counts as time: "depth" alone stands in many headers of
/// time volumes.
pub(super) fn says_depth_domain(text: &str) -> bool {
    let compact: String = text.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_uppercase).collect();
    ["DOMAINDEPTH", "DEPTHDOMAIN", "DOMAINISDEPTH"].iter().any(|phrase| compact.contains(phrase))
        && !compact.contains("TIMEDOMAIN")
        && !compact.contains("DOMAINTIME")
}

/// Depths that a header names whatever its samples are spaced in.
const OTHER_DEPTHS: [&str; 7] = ["water", "source", "receiver", "streamer", "cable", "gun", "shot"];

/// Whether the text speaks of depth, in words that do not say whether samples are spaced in it.
pub(super) fn may_mean_depth(text: &str) -> bool {
    let words: Vec<String> = text.split(|c: char| !c.is_alphanumeric()).map(str::to_lowercase).collect();
    let mut pairs = words
        .iter()
        .filter(|word| !word.is_empty())
        .scan("", |before, word| Some((std::mem::replace(before, word), word)));
    pairs.any(|(before, word)| word == "depth" && !OTHER_DEPTHS.contains(&before)) && !says_depth_domain(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ebcdic(text: &str) -> Vec<u8> {
        text.bytes()
            .map(|c| u8::try_from(CP037.iter().position(|&t| t == c).expect("cp037 is a bijection")).expect("byte"))
            .collect()
    }

    #[test]
    fn code_page_037_maps_one_to_one() {
        let mut seen = [false; 256];
        CP037.iter().for_each(|&c| seen[usize::from(c)] = true);
        assert!(seen.iter().all(|&s| s));
        assert_eq!(ebcdic("C 1 AZaz09"), [0xC3, 0x40, 0xF1, 0x40, 0xC1, 0xE9, 0x81, 0xA9, 0xF0, 0xF9]);
    }

    #[test]
    fn encoding_is_detected() {
        let text = format!("{:80}{:80}", "C 1 CLIENT somebody", "C 2 LINE 12");
        assert_eq!(detect(text.as_bytes()), Encoding::Ascii);
        assert_eq!(detect(&ebcdic(&text)), Encoding::Ebcdic);
        assert_eq!(detect(&[0; 3200]), Encoding::Ebcdic);
        assert_eq!(decode(&ebcdic(&text), Encoding::Ebcdic), "C 1 CLIENT somebody\nC 2 LINE 12");
    }

    #[test]
    fn end_stanza_is_found_in_both_encodings() {
        assert!(is_end_stanza(b"((SEG: EndText))   "));
        assert!(is_end_stanza(&ebcdic("((SEG:ENDTEXT))")));
        assert!(!is_end_stanza(b"((SEG:Layout))"));
        assert!(!is_end_stanza(b""));
    }

    #[test]
    fn what_may_be_depth_is_pointed_out() {
        assert!(may_mean_depth("C 7 FIRST DEPTH 10") && may_mean_depth("C29 Trace start time/depth : bytes 109-110"));
        assert!(!may_mean_depth("C 7 DOMAIN: DEPTH") && !may_mean_depth("C 7 4 ms; water depth in bytes 61"));
    }

    #[test]
    fn depth_needs_clear_words() {
        assert!(says_depth_domain("C 7 DOMAIN: DEPTH"));
        assert!(!says_depth_domain("C 7 first depth 10"));
        assert!(!says_depth_domain("TIME DOMAIN, converted from depth domain"));
    }
}
