//! Picture files of the window, with the records that `render` writes.

use std::borrow::Cow;
use std::io::{Seek, Write};

use supervol::Picture;
use supervol_scene::image::{EncodeError, ImageFormat};

use super::drawing::decorated;
use super::messages::Decorations;

/// Encodes a picture, with decorations if they are on, and with its record.
pub(super) fn encode(
    picture: &Picture,
    decorations: Decorations,
    format: ImageFormat,
    out: &mut (impl Write + Seek),
) -> Result<(), EncodeError> {
    let (image, resolved) = (picture.image(), picture.resolved());
    let shown = decorated(Cow::Borrowed(image), picture.volume(), resolved, decorations);
    let record = picture.record();
    let text = record.text_in(format, image, &shown);
    shown.encode_with(format, resolved.background, Some(&text), out)
}
