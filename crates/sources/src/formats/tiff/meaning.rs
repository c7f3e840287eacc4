//! Tags of a TIFF page that explain its numbers: GDAL's nodata, scale, offset and unit; inverted bits of masks. Also
//! the resolution, which is noted where it is none of paper.

use quick_xml::events::Event;
use tiff::decoder::ifd::Value;
use tiff::tags::Tag;

use super::description::{Calibration, fields_of_image_j};
use super::page::{Packing, refusal};
use super::{Page, Pages};
use crate::{Message, ReadOption, SourceError};

/// Tag of GDAL's metadata, which are XML.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Resolutions of screens and paper in dots per inch.
const OF_PAPER: [u32; 16] = [1, 50, 72, 75, 90, 96, 100, 120, 144, 150, 200, 240, 300, 400, 600, 1200];

impl Pages<'_> {
    /// Text of a tag of the current page; empty if there is none.
    fn text(&mut self, tag: Tag) -> Result<String, SourceError> {
        let value = self.decoder.find_tag(tag).map_err(|e| refusal(self.path, e))?;
        Ok(value.and_then(|value| value.into_string().ok()).unwrap_or_default())
    }

    /// Meaning of the numbers of the current page by GDAL. `channel` is the selected number of a pixel.
    pub(super) fn of_gdal(&mut self, channel: u64) -> Result<Calibration, SourceError> {
        let mut calibration = gdal_metadata(&self.text(GDAL_METADATA)?, channel);
        calibration.nodata = self.text(Tag::GdalNodata)?.trim_matches(['\0', ' ', '\n']).parse().ok();
        Ok(calibration)
    }

    /// Meaning of the numbers of a slice in a file of its own.
    pub(crate) fn calibration(
        &mut self,
        page: Page,
        channel: u64,
        notes: &mut Vec<Message>,
    ) -> Result<Calibration, SourceError> {
        let text = self.description()?;
        let of_image_j = (text.starts_with("ImageJ=") && !page.stored().is_float())
            .then(|| Calibration::of_image_j(&fields_of_image_j(&text), notes));
        of_image_j.flatten().map_or_else(|| self.of_gdal(channel), Ok)
    }

    /// Finds out whether single bits are the voxels although white is zero: tifffile writes truth values so.
    pub(super) fn choose_bits(&mut self) -> Result<(), SourceError> {
        self.keeps_bits = self.tag(Tag::PhotometricInterpretation)? == Some(0)
            && self.text(Tag::Software).is_ok_and(|program| program.starts_with("tifffile"));
        Ok(())
    }

    /// Notes the meaning of single bits where white is zero.
    pub(crate) fn note_bits(&mut self, page: Page, notes: &mut Vec<Message>) -> Result<(), SourceError> {
        if page.packing != Packing::Bits || self.tag(Tag::PhotometricInterpretation)? != Some(0) {
            return Ok(());
        }
        notes.push(if self.keeps_bits {
            "bits of a mask by tifffile, white is zero: true is 1, as stored".into()
        } else {
            "white is zero: bits are inverted, so that 1 is bright".into()
        });
        Ok(())
    }

    /// Notes the resolution of the current page, which is not used, unless it is one of paper or screens.
    pub(super) fn note_resolution(&mut self, notes: &mut Vec<Message>) -> Result<(), SourceError> {
        let per_inch = match self.tag(Tag::ResolutionUnit)? {
            Some(3) => 2.54,
            None | Some(2) => 1.0,
            _ => return Ok(()),
        };
        let [x, y] = [self.per_unit(Tag::XResolution)?, self.per_unit(Tag::YResolution)?];
        let (Some(x), Some(y)) = (x, y) else { return Ok(()) };
        // One pixel per unit states no size.
        let is_of_paper =
            |n: f64| OF_PAPER.iter().any(|known| (n * per_inch - f64::from(*known)).abs() < 0.6) || n == 1.0;
        if n_is_none(x) || n_is_none(y) || is_of_paper(x) || is_of_paper(y) {
            return Ok(());
        }
        let size =
            |n: f64| format!("{:.6}", 25.4 / (n * per_inch)).trim_end_matches('0').trim_end_matches('.').to_owned();
        let what = format!("its resolution makes pixels of {} x {} mm, which is not used: ", size(x), size(y));
        notes.push(Message::from(what).option(ReadOption::Spacing).text(" gives voxels a size"));
        Ok(())
    }

    /// Pixels per unit of length, by a tag of the current page.
    pub(super) fn per_unit(&mut self, tag: Tag) -> Result<Option<f64>, SourceError> {
        let value = self.decoder.find_tag(tag).map_err(|e| refusal(self.path, e))?;
        Ok(value.and_then(|value| match value {
            Value::Rational(above, below) => Some(f64::from(above) / f64::from(below)),
            other => other.into_f64().ok(),
        }))
    }
}

/// Whether a resolution is no number of pixels.
fn n_is_none(per_unit: f64) -> bool {
    !(per_unit.is_finite() && per_unit > 0.0)
}

/// Scale, offset and unit of a channel in GDAL's metadata.
fn gdal_metadata(text: &str, channel: u64) -> Calibration {
    let mut calibration = Calibration::default();
    let mut reader = quick_xml::Reader::from_str(text);
    let mut role = None;
    loop {
        match reader.read_event() {
            Ok(Event::Start(element)) => {
                let value = |name: &str| {
                    let found = element.attributes().flatten().find(|a| a.key.local_name().as_ref() == name);
                    found.map(|found| String::from_utf8_lossy(found.value.as_ref().as_ref()).into_owned())
                };
                let is_of_channel = value("sample").is_none_or(|sample| sample.parse() == Ok(channel));
                role = value("role").filter(|_| is_of_channel);
            }
            Ok(Event::Text(text)) => {
                let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
                match (role.as_deref(), number) {
                    (Some("scale"), Some(scale)) if scale != 0.0 => calibration.scale = scale,
                    (Some("offset"), Some(offset)) => calibration.offset = offset,
                    (Some("unittype"), _) => calibration.unit = crate::input::text::shortened(text.trim()),
                    _ => {}
                }
            }
            Ok(Event::End(_)) => role = None,
            Ok(Event::Eof) | Err(_) => return calibration,
            Ok(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_and_unit_by_gdal() {
        let text = "<GDALMetadata><Item name=\"OFFSET\" sample=\"0\" role=\"offset\">280</Item><Item name=\"SCALE\" \
                    sample=\"0\" role=\"scale\">0.01</Item><Item name=\"SCALE\" sample=\"1\" role=\"scale\">7</Item><Item \
                    name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">K</Item><Item name=\"x\">3</Item></GDALMetadata>";
        let found = gdal_metadata(text, 0);
        assert_eq!((found.scale, found.offset, found.unit.as_str()), (0.01, 280.0, "K"));
        assert_eq!(gdal_metadata(text, 1).scale, 7.0);
        assert_eq!(gdal_metadata("<broken", 0), Calibration::default());
    }
}
