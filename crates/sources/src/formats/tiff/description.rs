//! Description in a TIFF's first page: lines `key=value` by ImageJ, or OME-XML. It states which pages are the slices of
//! one volume, and the voxel spacing.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};

use crate::cast::index;
use crate::grid::absent::{ALL_VALID, AbsentNumbers};
use crate::input::selection::{Selection, first_of};
use crate::input::text::shortened;
use crate::input::values::{in_few_digits, line};
use crate::{Message, ReadOption, SourceError, SourceInfo};

/// Largest number of slices of a volume, and of pages of a file.
pub(super) const PAGES_LIMIT: usize = 1 << 16;

/// Contents of a description.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Description {
    /// Pages that are the slices, in order; `None`: all pages.
    pub(super) slices: Option<Vec<usize>>,
    /// World distances between voxels along x, y, z, if known; ImageJ states x and y elsewhere.
    pub(super) spacing: [Option<f64>; 3],
    /// Unit of the spacing; empty if unknown.
    pub(super) unit: String,
    /// Whether the page's resolution is in pixels per unit.
    pub(super) has_resolution: bool,
    /// Meaning of the numbers of 8 and 16 bits.
    pub(super) calibration: Option<Calibration>,
    /// Notes for the user.
    pub(super) notes: Vec<Message>,
}

/// Meaning of stored numbers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Calibration {
    /// Value = stored * scale + offset.
    pub(super) scale: f64,
    pub(super) offset: f64,
    /// Unit of the values; empty if unknown.
    pub(super) unit: String,
    /// Stored number that is absent.
    pub(super) nodata: Option<f64>,
}

impl Default for Calibration {
    fn default() -> Self {
        Self { scale: 1.0, offset: 0.0, unit: String::new(), nodata: None }
    }
}

impl Calibration {
    /// ImageJ's calibration; `None` if there is none. Others than a straight line are noted.
    pub(super) fn of_image_j(fields: &HashMap<&str, &str>, notes: &mut Vec<Message>) -> Option<Self> {
        let number = |name: &str| fields.get(name)?.trim().parse::<f64>().ok().filter(|n| n.is_finite());
        let function = fields.get("cf")?.trim();
        if function != "0" {
            notes.push(format!("calibration function {} of ImageJ is not applied", shortened(function)).into());
            return None;
        }
        let (offset, scale) = (number("c0")?, number("c1").filter(|scale| *scale != 0.0)?);
        let unit = fields.get("vunit").map(|unit| shortened(unit.trim())).filter(|unit| unit != "Gray Value");
        Some(Self { scale, offset, unit: unit.unwrap_or_default(), nodata: None })
    }

    /// Puts scale, offset, unit and absent value into the description of a volume, and notes them.
    pub(crate) fn apply(&self, info: &mut SourceInfo) {
        (info.scale, info.offset) = (self.scale, self.offset);
        info.unit.clone_from(&self.unit);
        info.nodata = AbsentNumbers::new(info.voxel_type, self.nodata.as_slice(), ALL_VALID).and_then(|a| a.nodata());
        let mut said: Vec<String> = line(self.scale, self.offset).into_iter().collect();
        said.extend(info.nodata.map(|nodata| format!("absent: {}", in_few_digits(nodata, info.voxel_type))));
        if !said.is_empty() {
            let what = format!("tags of the file are applied ({}); ", said.join("; "));
            info.notes.push(Message::from(what).option(ReadOption::Values).text(" ignores them"));
        }
    }
}

/// Fields of ImageJ's description.
pub(super) fn fields_of_image_j(text: &str) -> HashMap<&str, &str> {
    text.lines().filter_map(|line| line.split_once('=')).collect()
}

/// Sizes of a series besides x and y, and the number of pages between neighbours along each axis.
#[derive(Debug, Clone, Copy)]
struct Series {
    /// Numbers of slices, channels, times.
    sizes: [usize; 3],
    /// Pages from one slice, channel or time to the next.
    strides: [usize; 3],
}

impl Series {
    /// From the numbers of slices, channels and times, and the order of these axes, fastest first.
    fn new(sizes: [usize; 3], fastest_first: [usize; 3]) -> Option<Self> {
        let (mut strides, mut product) = ([0; 3], 1usize);
        for axis in fastest_first {
            strides[axis] = product;
            product = product.checked_mul(sizes[axis])?;
        }
        (1..=PAGES_LIMIT).contains(&product).then_some(Self { sizes, strides })
    }

    /// Pages of the slices of the selected channel and time; by default the first. A series of times alone is read as
    /// slices. If `samples` is more than 1, the channels are the numbers of a pixel. `names` are the file's names of
    /// the channels, if any.
    fn slices(
        &self,
        path: &Path,
        samples: u64,
        selection: &Selection,
        (names, notes): (&[String], &mut Vec<Message>),
    ) -> Result<Vec<usize>, SourceError> {
        let [slices, channels, times] = self.sizes;
        let mut first = 0;
        if samples == 1 {
            first += index(selection.noted_channel(path, channels as u64, names, notes)?) * self.strides[1];
        }
        if slices == 1 && times > 1 && channels == 1 && selection.frame.is_none() {
            notes.push(format!("{times} time points of one slice: read as slices").into());
            return Ok((0..times).map(|i| i * self.strides[2]).collect());
        }
        first += index(selection.noted_frame(path, times as u64, "time points", notes)?) * self.strides[2];
        Ok((0..slices).map(|i| first + i * self.strides[0]).collect())
    }
}

impl Description {
    /// Parses a description; one of an unknown kind is empty.
    ///
    /// # Errors
    /// If a description of a known kind is inconsistent, or refers to several files.
    pub(super) fn read(path: &Path, text: &str, samples: u64, selection: &Selection) -> Result<Self, SourceError> {
        if text.contains("<OME") {
            return Self::of_ome(path, text, samples, selection);
        }
        selection.refuse_series(path)?;
        if text.starts_with("ImageJ=") {
            return Self::of_image_j(path, text, samples, selection);
        }
        selection.frame_of(path, 1)?;
        if samples == 1 {
            selection.channel_of(path, 1)?;
        }
        Ok(Self::default())
    }

    fn of_image_j(path: &Path, text: &str, samples: u64, selection: &Selection) -> Result<Self, SourceError> {
        let fields = fields_of_image_j(text);
        let count = |name: &str| match fields.get(name) {
            None => Ok(None),
            Some(text) => {
                text.trim().parse().ok().filter(|n| (1..=PAGES_LIMIT).contains(n)).map(Some).ok_or_else(|| {
                    let expected = format!("a number of 1 to {PAGES_LIMIT}");
                    SourceError::invalid(path, format!("ImageJ description, {name}"), expected, shortened(text))
                })
            }
        };
        let images = count("images")?.unwrap_or(1);
        let (channels, slices, frames) = (count("channels")?, count("slices")?, count("frames")?);
        // A stack that is not a hyperstack states only its number of images.
        let is_plain = channels.is_none() && slices.is_none() && frames.is_none();
        let slices = if is_plain { images } else { slices.unwrap_or(1) };
        let sizes = [slices, channels.unwrap_or(1), frames.unwrap_or(1)];
        // Channels are fastest, then slices, then times.
        let series = Series::new(sizes, [1, 0, 2]).ok_or_else(|| {
            let expected = format!("at most {PAGES_LIMIT} pages");
            SourceError::invalid(path, "ImageJ description", expected, format!("{sizes:?} slices, channels, times"))
        })?;
        let mut notes = Vec::new();
        let slices = Some(series.slices(path, samples, selection, (&[], &mut notes))?);
        let between = fields.get("spacing").and_then(|s| s.trim().parse().ok());
        let unit = fields.get("unit").map(|unit| unit_of(unit)).unwrap_or_default();
        let has_resolution = !unit.is_empty() && unit != "pixel";
        let spacing = [None, None, between.filter(|_| has_resolution).map(f64::abs)];
        let calibration = Calibration::of_image_j(&fields, &mut notes);
        let unit = if has_resolution { unit } else { String::new() };
        Ok(Self { slices, spacing, unit, has_resolution, calibration, notes })
    }

    fn of_ome(path: &Path, text: &str, samples: u64, selection: &Selection) -> Result<Self, SourceError> {
        let wrong = |found: String| SourceError::invalid(path, "OME-XML", "an element `Pixels` with its sizes", found);
        let mut found = Ome { samples: index(samples), wanted: wanted_series(path, selection)?, ..Ome::default() };
        let mut reader = quick_xml::Reader::from_str(text);
        loop {
            match reader.read_event() {
                Ok(Event::Start(element) | Event::Empty(element)) => found.take(&element).map_err(&wrong)?,
                Ok(Event::Eof) => break,
                Ok(_) => {}
                Err(error) => return Err(wrong(shortened(&error.to_string()))),
            }
        }
        if found.files.len() > 1 || found.is_elsewhere {
            let what = match found.files.len() {
                0 | 1 => "it is one of several files of an OME-TIFF, whose OME-XML is in another".into(),
                count => format!("its OME-XML spreads the volume over {count} files"),
            };
            let advice =
                "give their folder, if each holds one slice, or join them: `bfconvert IN OUT.ome.tif` (Bio-Formats)";
            return Err(SourceError::unsupported(path, what, advice));
        }
        if found.wanted > 0 && found.wanted >= found.images {
            let what =
                format_args!(" {}: {} has {} series, counted from 0 on", found.wanted, path.display(), found.images);
            return Err(SourceError::options(Message::from(ReadOption::Series).text(what)));
        }
        let series = found.series.ok_or_else(|| wrong("none".into()))?;
        let mut notes = Vec::new();
        if found.images > 1 && selection.series.is_none() {
            notes.push(first_of(&format!("{} series", found.images), ReadOption::Series, found.images as u64));
        }
        let planes = series.slices(path, samples, selection, (&found.channels, &mut notes))?;
        let slices = planes.into_iter().map(|plane| found.page_of(plane)).collect::<Option<_>>();
        let slices = slices.ok_or_else(|| wrong("a slice that no `TiffData` has a page for".into()))?;
        let units: Vec<&String> =
            found.units.iter().zip(found.spacing).filter_map(|(unit, spacing)| spacing.map(|_| unit)).collect();
        let is_one_unit = units.windows(2).all(|pair| pair[0] == pair[1]);
        if !is_one_unit {
            notes.push("voxel sizes have different units: not used".into());
        }
        let mut spacing = if is_one_unit { found.spacing } else { [None; 3] };
        if let [Some(one), None, _] | [None, Some(one), _] = spacing {
            notes.push("the size of pixels is stated along one axis only: taken for x and y".into());
            [spacing[0], spacing[1]] = [Some(one); 2];
        }
        if let ([Some(_), _, None], Some(1..)) = (spacing, found.series.map(|series| series.sizes[0] - 1)) {
            let what = Message::from("the distance of slices is not stated: replaced by 1; ");
            notes.push(what.option(ReadOption::Spacing).text(" gives it"));
        }
        let unit = units.first().filter(|_| is_one_unit).map_or_else(String::new, |unit| (*unit).clone());
        Ok(Self { slices: Some(slices), spacing, unit, has_resolution: false, calibration: None, notes })
    }
}

/// The used parts of OME-XML.
#[derive(Debug, Default)]
struct Ome {
    /// Numbers per pixel of a page.
    samples: usize,
    /// Number of the selected series.
    wanted: usize,
    images: usize,
    series: Option<Series>,
    spacing: [Option<f64>; 3],
    units: [String; 3],
    /// Names of the channels; empty for a channel without a name.
    channels: Vec<String>,
    /// First plane, first page, number of planes; if the list is empty, planes are pages.
    places: Vec<[usize; 3]>,
    files: BTreeSet<String>,
    /// Whether the file only names another file with the full description.
    is_elsewhere: bool,
}

impl Ome {
    /// Handles an element; only those of the selected series count.
    fn take(&mut self, element: &BytesStart<'_>) -> Result<(), String> {
        let mut attributes = HashMap::new();
        for attribute in element.attributes() {
            let attribute = attribute.map_err(|e| shortened(&e.to_string()))?;
            let value = attribute
                .normalized_value(XmlVersion::Implicit1_0)
                .map_err(|e| shortened(&e.to_string()))?
                .into_owned();
            attributes.insert(attribute.key.local_name().as_ref().to_owned(), value);
        }
        let is_wanted = self.images == self.wanted + 1;
        match element.local_name().as_ref() {
            "Image" => self.images += 1,
            "Pixels" if is_wanted => self.pixels(&attributes)?,
            "Channel" if is_wanted && self.channels.len() < PAGES_LIMIT => {
                self.channels.push(attributes.remove("Name").unwrap_or_default());
            }
            "TiffData" if is_wanted => self.place(&attributes)?,
            "BinaryOnly" => self.is_elsewhere = true,
            "UUID" if is_wanted => self.files.extend(attributes.remove("FileName")),
            _ => {}
        }
        Ok(())
    }

    fn pixels(&mut self, attributes: &HashMap<String, String>) -> Result<(), String> {
        let size = |name: &str| number(attributes, name)?.ok_or_else(|| format!("no {name}"));
        // Samples of one pixel are not planes of their own.
        let sizes = [size("SizeZ")?, (size("SizeC")? / self.samples.max(1)).max(1), size("SizeT")?];
        let order = attributes.get("DimensionOrder").map_or("XYZCT", String::as_str);
        let mut axes: Vec<usize> = order.chars().skip(2).filter_map(|c| "ZCT".find(c)).collect();
        let fastest_first = axes.clone();
        axes.sort_unstable();
        let is_whole = order.starts_with("XY") && order.len() == 5 && axes == [0, 1, 2];
        let axes = fastest_first.try_into().ok().filter(|_| is_whole).ok_or_else(|| shortened(order))?;
        self.series = Some(Series::new(sizes, axes).ok_or_else(|| format!("{sizes:?} slices, channels, times"))?);
        for (i, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            let stated = attributes.get(&format!("PhysicalSize{axis}")).and_then(|text| text.parse::<f64>().ok());
            self.spacing[i] = stated.filter(|s| s.is_finite() && *s > 0.0);
            self.units[i] = unit_of(attributes.get(&format!("PhysicalSize{axis}Unit")).map_or("µm", String::as_str));
        }
        Ok(())
    }

    fn place(&mut self, attributes: &HashMap<String, String>) -> Result<(), String> {
        let Some(series) = self.series else { return Err("TiffData before Pixels".into()) };
        let at = |name: &str| number(attributes, name).map(|n| n.unwrap_or(0));
        let firsts = [at("FirstZ")?, at("FirstC")?, at("FirstT")?];
        let plane = (0..3).map(|axis| firsts[axis].saturating_mul(series.strides[axis])).fold(0, usize::saturating_add);
        let page = number(attributes, "IFD")?;
        let planes = number(attributes, "PlaneCount")?.unwrap_or(if page.is_some() { 1 } else { PAGES_LIMIT });
        if self.places.len() >= PAGES_LIMIT {
            return Err(format!("more than {PAGES_LIMIT} elements TiffData"));
        }
        self.places.push([plane, page.unwrap_or(0), planes]);
        Ok(())
    }

    /// The page of a plane.
    fn page_of(&self, plane: usize) -> Option<usize> {
        if self.places.is_empty() {
            return Some(plane);
        }
        // Usually the entries are in order, one per plane.
        let holds = |&&[first, _, planes]: &&[usize; 3]| plane.checked_sub(first).is_some_and(|behind| behind < planes);
        let place = self.places.get(plane).filter(holds).or_else(|| self.places.iter().find(holds));
        place.map(|&[first, page, _]| page.saturating_add(plane - first))
    }
}

/// Number of the selected series of an OME-TIFF, counted from 0; by default the first.
fn wanted_series(path: &Path, selection: &Selection) -> Result<usize, SourceError> {
    let Some(text) = &selection.series else { return Ok(0) };
    let number = text.parse().ok().filter(|n| *n < PAGES_LIMIT);
    number.ok_or_else(|| {
        let expected = "expected the number of a series of OME, from 0 on";
        let what = format_args!(" {}: {expected}, for {}", shortened(text), path.display());
        SourceError::options(Message::from(ReadOption::Series).text(what))
    })
}

fn number(attributes: &HashMap<String, String>, name: &str) -> Result<Option<usize>, String> {
    let Some(text) = attributes.get(name) else { return Ok(None) };
    text.trim()
        .parse()
        .ok()
        .filter(|n| *n <= PAGES_LIMIT)
        .map(Some)
        .ok_or_else(|| format!("{name} {}", shortened(text)))
}

/// Unit in our spelling.
fn unit_of(text: &str) -> String {
    match text.trim() {
        "micron" | "microns" | "um" | "µm" | "μm" | "\\u00B5m" | "Â\u{b5}m" => "um".into(),
        // Not a unit: distances in voxels.
        "reference frame" => String::new(),
        other => shortened(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Description, SourceError> {
        Description::read("d.tif".as_ref(), text, 1, &Selection::default())
    }

    #[test]
    fn stacks_of_image_j() {
        let found = read("ImageJ=1.53\nimages=4\nspacing=2.5\nunit=micron\n").expect("a stack");
        assert_eq!(found.slices, Some(vec![0, 1, 2, 3]));
        assert_eq!((found.spacing[2], found.unit.as_str(), found.has_resolution), (Some(2.5), "um", true));
        let found = read("ImageJ=1.53\nimages=24\nchannels=2\nslices=4\nframes=3\nhyperstack=true").expect("a stack");
        assert_eq!(found.slices, Some(vec![0, 2, 4, 6]));
        assert_eq!(found.notes.len(), 2, "{:?}", found.notes);
        let found = read("ImageJ=1.53\nimages=9\nframes=9\n").expect("a stack");
        assert_eq!(found.slices.map(|s| s.len()), Some(9));
        assert!(read("ImageJ=1.53\nimages=-3").is_err() && read("ImageJ=1\nslices=99999\nframes=99999").is_err());
        assert_eq!(read("anything").expect("nothing"), Description::default());
    }

    #[test]
    fn series_of_ome() {
        let xml = |pixels: &str, inside: &str| {
            format!("<?xml version=\"1.0\"?><OME><Image><Pixels {pixels}>{inside}</Pixels></Image></OME>")
        };
        let sizes = "SizeX=\"9\" SizeY=\"9\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"2\"";
        let pages = |order: &str, inside: &str| {
            read(&xml(&format!("DimensionOrder=\"{order}\" {sizes}"), inside)).map(|d| d.slices.expect("pages"))
        };
        assert_eq!(pages("XYZCT", "").expect("pages"), [0, 1, 2]);
        assert_eq!(pages("XYCZT", "").expect("pages"), [0, 2, 4]);
        assert_eq!(pages("XYTCZ", "").expect("pages"), [0, 4, 8]);
        assert_eq!(pages("XYZCT", "<TiffData/>").expect("pages"), [0, 1, 2]);
        let backward = "<TiffData FirstZ=\"2\" IFD=\"0\"/><TiffData FirstZ=\"1\" IFD=\"1\"/><TiffData IFD=\"2\"/>";
        assert_eq!(pages("XYZCT", backward).expect("pages"), [2, 1, 0]);
        assert!(pages("XYZCT", "<TiffData FirstZ=\"1\" IFD=\"0\"/>").is_err());
        assert!(pages("XYZZT", "").is_err() && pages("ZXYCT", "").is_err());
        let files = "<TiffData><UUID FileName=\"a\"/></TiffData><TiffData><UUID FileName=\"b\"/></TiffData>";
        assert!(pages("XYZCT", files).expect_err("two files").to_string().contains("2 files"));
        let named = "<Channel ID=\"C:0\" Name=\"DAPI\"/><Channel ID=\"C:1\"><LightPath/></Channel>";
        let found = read(&xml(&format!("DimensionOrder=\"XYZCT\" {sizes}"), named)).expect("channels");
        let notes: Vec<String> = found.notes.iter().map(ToString::to_string).collect();
        assert!(notes.contains(&"2 channels (DAPI); the first is used; `channel` 0 to 1 takes another".into()));
        let physical = "PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"2\" PhysicalSizeZUnit=\"µm\"";
        let found = read(&xml(&format!("{sizes} {physical}"), "")).expect("sizes");
        assert_eq!((found.spacing, found.unit.as_str()), ([Some(0.5), Some(0.5), Some(2.0)], "um"));
        assert!(read("<OME><Image><Pixels SizeZ=\"x\"/></Image></OME>").is_err() && read("<OME></OME>").is_err());
    }
}
