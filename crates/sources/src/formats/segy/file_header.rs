//! The two headers at the beginning of a SEG-Y file.

use super::binary_header::{BinaryHeader, FILE_HEADER_BYTES};
use super::input::Input;
use super::options::SegyOptions;
use super::text_header::{self, TEXT_BYTES};
use crate::cast::index;
use crate::{Message, ReadOption, SourceError};

/// Reads text and binary header.
pub(super) fn read_file_header(input: Input<'_>, options: &SegyOptions) -> Result<(String, BinaryHeader), SourceError> {
    let file_bytes = input.len()?;
    if file_bytes < FILE_HEADER_BYTES {
        let expected = format!("at least the {FILE_HEADER_BYTES} bytes of the file headers");
        return Err(input.invalid("file size", expected, format!("{file_bytes} bytes")));
    }
    let mut headers = [0; index(FILE_HEADER_BYTES)];
    input.read(0, &mut headers)?;
    let (text, binary) = headers.split_at(TEXT_BYTES);
    if matches!(&text[4..7], b"SY1" | b"SY2") {
        let advice = "cut off its first 128 bytes";
        return Err(input.unsupported("the file begins with a tape label (SEG storage unit label)", advice));
    }
    let binary = binary.first_chunk().expect("400 bytes follow the text header");
    let header = BinaryHeader::read(binary, file_bytes, options).map_err(|what| {
        let advice = Message::from("say ").option(ReadOption::Endian).text(" big or ");
        input.unsupported(what, advice.option(ReadOption::Endian).text(" little"))
    })?;
    Ok((text_header::decode(text, text_header::detect(text)), header))
}
