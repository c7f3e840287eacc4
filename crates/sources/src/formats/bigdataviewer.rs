//! `BigDataViewer`: an XML file that names an HDF5 file or an N5 folder with the voxels. It states the voxel sizes and
//! the placement of each view.
//!
//! A view is a setup (`channel`, in the order of the file) at a time point (`frame`, in numerical order).
//! `level` selects a level of the viewer's own pyramid. The placement of a view is the product of its
//! transforms; without transforms, the voxel size. [`super::hdf5`] and [`super::zarr`] read the voxels. Data outside
//! the folder of the XML file are read only if allowed. Format: Pietzsch, Saalfeld, Preibisch and Tomancak,
//! "`BigDataViewer`: visualization and processing for large image data sets", Nature Methods 12 (2015), and
//! <https://imagej.net/plugins/bdv>.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use glam::{DAffine3, DVec3};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use supervol_format::{Geometry, VoxelBox};

use super::zarr::ome::unit_of;
use super::{hdf5, zarr};
use crate::cast::index;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::input::data_files::{Outside, find_all};
use crate::input::file::SourceFile;
use crate::input::folder::FolderOptions;
use crate::input::selection::{Choice, Selection, first_of};
use crate::input::text::shortened;
use crate::{Axis, Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// First element of such a file.
const START: &[u8] = b"<SpimData";
/// Longest file that is read, in bytes: room for tens of thousands of views.
const XML_LIMIT_BYTES: u64 = 64 << 20;
/// Largest number of setups, and of views.
const VIEWS_LIMIT: usize = 1 << 17;
/// Largest depth of nested elements.
const DEPTH_LIMIT: usize = 64;

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "bdv",
    title: "BigDataViewer",
    endings: &[".xml"],
    choices: &[Choice::Level, Choice::Series, Choice::Array],
    sniff: |start, _| start.begins_with(START) || start.text_begins_with(b"<?xml") && start.holds(START),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(ViewerXmlSource::open(path, &options.of_folders())?)),
    found: |_| Found::Volume,
};

/// A view of a data set.
pub struct ViewerXmlSource {
    voxels: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl std::fmt::Debug for ViewerXmlSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ViewerXmlSource").field("info", &self.info).finish_non_exhaustive()
    }
}

impl ViewerXmlSource {
    /// Opens the selected view.
    ///
    /// # Errors
    /// If the XML file breaks its rules, or there is no such view. If its data are of an unsupported kind or lie
    /// outside its folder. Also as [`hdf5::open`] and [`zarr::open`].
    pub fn open(path: &Path, options: &FolderOptions<'_>) -> Result<Self, SourceError> {
        options.selection.refuse_series(path)?;
        options.selection.refuse_array(path)?;
        let source_file = SourceFile::of(path)?;
        let described = Described::read(path)?;
        let data = described.data(path, options.outside)?;
        let mut notes = Vec::new();
        let view = described.view(path, options.selection, &mut notes)?;
        let level = options.selection.level.unwrap_or(0);
        let View { setup, time } = view;
        let (name, is_hdf5) = match described.loader.as_str() {
            HDF5 => (format!("t{time:05}/s{:02}/{level}/cells", setup.id), true),
            _ => (format!("setup{}/timepoint{time}/s{level}", setup.id), false),
        };
        let selection = Selection { array: Some(name.clone()), ..Selection::default() };
        let of_data = FolderOptions { selection: &selection, ..options.clone() };
        let opened: Result<Box<dyn VolumeSource>, SourceError> = if is_hdf5 {
            hdf5::open(&data, &of_data).map(|source| Box::new(source) as _)
        } else {
            zarr::open(&data, &of_data).map(|source| Box::new(source) as _)
        };
        let voxels = opened.map_err(|error| match error {
            SourceError::Options(_) | SourceError::NoSuchPart { .. } | SourceError::Invalid { .. }
                if options.selection.level.is_some() =>
            {
                let what = format_args!(" {level}: {}: no readable `{name}`: ", data.display());
                SourceError::options(Message::from(ReadOption::Level).text(what).message(error.message()))
            }
            other => other,
        })?;
        let mut info = voxels.info().clone();
        (info.format, info.folder) = ("bdv", None);
        let factors = if is_hdf5 {
            voxels.info().geometry.spacing
        } else {
            let of_setup = format!("setup{}", setup.id);
            zarr::factors_of_viewer(&data, options.outside, (&of_setup, &name, level))?.unwrap_or([1.0; 3])
        };
        info.geometry = setup.geometry(described.place_of(view), factors);
        if let Some(defect) = info.geometry.defect() {
            return Err(SourceError::invalid(path, "place of the view", "axes that span a volume", defect));
        }
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: setup.unit.clone() });
        info.files.insert(0, source_file);
        // The voxel reader notes that it does not know the spacing; here it is known.
        info.notes.retain(|note| !note.options().any(|option| option == ReadOption::Spacing));
        info.notes.append(&mut notes);
        Ok(Self { voxels, info })
    }
}

/// File or folder of the voxels that such an XML file names, if it lies below the XML file's folder. `None` if the file
/// is of another kind or cannot be read.
pub fn data_of(path: &Path) -> Option<PathBuf> {
    Described::read(path).ok()?.data(path, Outside::Refused).ok()
}

impl VolumeSource for ViewerXmlSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.voxels.read_box(voxels, out)
    }
}

/// Supported data formats.
const HDF5: &str = "bdv.hdf5";
const N5: &str = "bdv.n5";

/// A channel, angle or tile. Every time point has a view of it.
#[derive(Debug, Clone, PartialEq, Default)]
struct Setup {
    id: u64,
    unit: String,
    voxel_size: Option<[f64; 3]>,
}

/// A setup at a time point.
#[derive(Debug, Clone, Copy)]
struct View<'a> {
    setup: &'a Setup,
    time: u64,
}

/// Contents of the XML file.
#[derive(Debug, Default, PartialEq)]
struct Described {
    base: String,
    loader: String,
    /// Name of the data, and whether it is relative to the XML file.
    data: Option<(String, bool)>,
    setups: Vec<Setup>,
    /// Time point, setup, and the product of the transforms, if there are any.
    places: Vec<(u64, u64, Option<DAffine3>)>,
}

impl Described {
    fn read(path: &Path) -> Result<Self, SourceError> {
        let io = |e| SourceError::io(path, e);
        let mut bytes = Vec::new();
        File::open(path).map_err(io)?.take(XML_LIMIT_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
        if bytes.len() as u64 > XML_LIMIT_BYTES {
            return Err(SourceError::invalid(path, "XML", format!("at most {XML_LIMIT_BYTES} bytes"), "more"));
        }
        let text = String::from_utf8_lossy(&bytes);
        Self::parse(&text).map_err(|found| SourceError::invalid(path, "XML", "a data set of BigDataViewer", found))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut reader = quick_xml::Reader::from_str(text);
        let (mut described, mut inside) = (Self::default(), Vec::<String>::new());
        loop {
            let event = reader.read_event().map_err(|e| shortened(&e.to_string()))?;
            match event {
                Event::Start(element) => {
                    described.begin(&element)?;
                    if inside.len() >= DEPTH_LIMIT {
                        return Err(format!("elements in elements, {DEPTH_LIMIT} deep"));
                    }
                    inside.push(element.local_name().as_ref().to_owned());
                }
                Event::Empty(element) => described.begin(&element)?,
                Event::Text(text) => described.take(&inside, &text)?,
                // File names may contain an escaped `&`.
                Event::GeneralRef(name) => {
                    described.take(&inside, quick_xml::escape::resolve_predefined_entity(&name).unwrap_or("?"))?
                }
                Event::End(_) => drop(inside.pop()),
                Event::Eof => return Ok(described),
                _ => {}
            }
        }
    }

    /// Handles the beginning of an element.
    fn begin(&mut self, element: &BytesStart<'_>) -> Result<(), String> {
        let value = |wanted: &str| -> Result<Option<String>, String> {
            for attribute in element.attributes() {
                let attribute = attribute.map_err(|e| shortened(&e.to_string()))?;
                if attribute.key.local_name().as_ref() == wanted {
                    let value = attribute.normalized_value(XmlVersion::Implicit1_0);
                    return value.map(|value| Some(value.into_owned())).map_err(|e| shortened(&e.to_string()));
                }
            }
            Ok(None)
        };
        let count = |wanted: &str| value(wanted)?.ok_or_else(|| format!("no {wanted}")).and_then(|text| whole(&text));
        match element.local_name().as_ref() {
            "ImageLoader" => self.loader = value("format")?.unwrap_or_default(),
            "hdf5" | "n5" if self.data.is_none() => {
                let is_relative = value("type")?.is_none_or(|kind| kind == "relative");
                self.data = Some((String::new(), is_relative));
            }
            "ViewSetup" => self.setups.push(Setup::default()),
            "ViewRegistration" => self.places.push((count("timepoint")?, count("setup")?, None)),
            _ => {}
        }
        if self.setups.len().max(self.places.len()) > VIEWS_LIMIT {
            return Err(format!("more than {VIEWS_LIMIT} views"));
        }
        Ok(())
    }

    /// Handles the text of an element.
    fn take(&mut self, inside: &[String], text: &str) -> Result<(), String> {
        let names: Vec<&str> = inside.iter().rev().map(String::as_str).collect();
        match names[..] {
            // Escaped characters split a text into several parts.
            ["BasePath", ..] => self.base += text,
            ["hdf5" | "n5", "ImageLoader", ..] => self.data.iter_mut().for_each(|(name, _)| name.push_str(text)),
            _ if text.trim().is_empty() => {}
            ["id", "ViewSetup", ..] => self.setup()?.id = whole(text)?,
            ["unit", "voxelSize", ..] => self.setup()?.unit = unit_of(text.trim()),
            ["size", "voxelSize", ..] => {
                let sizes = numbers::<3>(text)?;
                if !sizes.iter().all(|size| *size > 0.0) {
                    return Err(format!("voxels of {}", shortened(text)));
                }
                self.setup()?.voxel_size = Some(sizes);
            }
            ["affine", "ViewTransform", ..] => {
                let [a, b, c, x, d, e, f, y, g, h, i, z] = numbers::<12>(text)?;
                let one = DAffine3::from_cols_array(&[a, d, g, b, e, h, c, f, i, x, y, z]);
                let place = self.places.last_mut().ok_or("a transform of no view")?;
                // The transform that is listed first is applied last.
                place.2 = Some(place.2.map_or(one, |before| before * one));
            }
            _ => {}
        }
        Ok(())
    }

    fn setup(&mut self) -> Result<&mut Setup, String> {
        self.setups.last_mut().ok_or_else(|| "a setup's part outside of any".into())
    }

    /// Path of the voxel data.
    fn data(&self, path: &Path, outside: Outside) -> Result<PathBuf, SourceError> {
        if ![HDF5, N5].contains(&self.loader.as_str()) {
            let what =
                format!("this is a BigDataViewer file whose data are in the format `{}`", shortened(&self.loader));
            let advice =
                "bdv.hdf5 and bdv.n5 are read: export it with the BigDataViewer or BigStitcher plugins of Fiji";
            return Err(SourceError::unsupported(path, what, advice));
        }
        let named = self.data.as_ref().filter(|(name, _)| !name.trim().is_empty());
        let (name, is_relative) =
            named.ok_or_else(|| SourceError::invalid(path, "ImageLoader", "the name of its data", "none"))?;
        let base = if *is_relative { self.base.trim() } else { "" };
        let joined = Path::new(base).join(name.trim());
        let plain: PathBuf = joined.components().filter(|part| *part != Component::CurDir).collect();
        let name = plain.to_string_lossy().into_owned();
        let found = find_all(path, std::slice::from_ref(&name), outside)?;
        let data = found.into_iter().next().unwrap_or_default();
        if data.exists() {
            return Ok(data);
        }
        let found = format!("nothing at {}", data.display());
        Err(SourceError::invalid(path, "ImageLoader", "the data that it names", found))
    }

    /// The selected view.
    fn view(&self, path: &Path, selection: &Selection, notes: &mut Vec<Message>) -> Result<View<'_>, SourceError> {
        let setups = self.setups.len() as u64;
        if setups == 0 {
            return Err(SourceError::invalid(path, "ViewSetups", "at least one", "none"));
        }
        if setups > 1 && selection.channel.is_none() {
            notes.push(first_of(&format!("{setups} setups"), ReadOption::Channel, setups));
        }
        let setup = &self.setups[index(selection.channel_of(path, setups)?)];
        let mut times: Vec<u64> = self.places.iter().map(|(time, ..)| *time).collect();
        times.sort_unstable();
        times.dedup();
        if times.is_empty() {
            times.push(0);
        }
        let time = times[index(selection.noted_frame(path, times.len() as u64, "time points", notes)?)];
        Ok(View { setup, time })
    }

    fn place_of(&self, view: View<'_>) -> Option<DAffine3> {
        let is_of_view = |(time, setup, _): &&(u64, u64, _)| (*time, *setup) == (view.time, view.setup.id);
        self.places.iter().find(is_of_view).and_then(|(.., place)| *place)
    }
}

impl Setup {
    /// Geometry of a level whose voxels cover `factors` of the finest voxels per axis. A coarse voxel lies at the
    /// centre of its fine ones.
    fn geometry(&self, place: Option<DAffine3>, factors: [f64; 3]) -> Geometry {
        let of_size = || DAffine3::from_scale(DVec3::from_array(self.voxel_size.unwrap_or([1.0; 3])));
        let place = place.unwrap_or_else(of_size);
        let origin = place.transform_point3(DVec3::from_array(factors.map(|factor| 0.5 * (factor - 1.0))));
        let columns: [DVec3; 3] = std::array::from_fn(|axis| factors[axis] * place.matrix3.col(axis));
        let spacing = columns.map(DVec3::length);
        let direction = std::array::from_fn(|i| columns[i % 3][i / 3] / spacing[i % 3]);
        Geometry { spacing, origin: origin.to_array(), direction }
    }
}

fn whole(text: &str) -> Result<u64, String> {
    text.trim().parse().map_err(|_| format!("`{}`, which is no whole number", shortened(text)))
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> =
        text.split_whitespace().map(|word| word.parse().ok().filter(|n: &f64| n.is_finite())).collect();
    let wrong = || format!("`{}`, where {N} numbers are expected", shortened(text));
    parsed.and_then(|numbers| numbers.try_into().ok()).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETUP: &str =
        "<ViewSetup><id>7</id><voxelSize><unit>micrometer</unit><size>0.5 0.25 2</size></voxelSize></ViewSetup>";

    fn xml(inside: &str) -> String {
        format!(
            "<?xml version=\"1.0\"?><SpimData version=\"0.2\"><BasePath type=\"relative\">.</BasePath><SequenceDescription>\
             <ImageLoader format=\"bdv.hdf5\"><hdf5 type=\"relative\">a &amp; b.h5</hdf5></ImageLoader><ViewSetups>{SETUP}</ViewSetups>\
             </SequenceDescription>{inside}</SpimData>"
        )
    }

    #[test]
    fn what_a_data_set_says() {
        let found = Described::parse(&xml("")).expect("a data set");
        assert_eq!((found.base.as_str(), found.loader.as_str()), (".", HDF5));
        assert_eq!(found.data, Some(("a & b.h5".into(), true)));
        let setup = Setup { id: 7, unit: unit_of("micrometer"), voxel_size: Some([0.5, 0.25, 2.0]) };
        assert_eq!(found.setups, std::slice::from_ref(&setup));
        // Without a transform: from the voxel size, with a coarse voxel at the centre of its fine ones.
        let fine = setup.geometry(None, [1.0; 3]);
        assert_eq!((fine.spacing, fine.origin), ([0.5, 0.25, 2.0], [0.0; 3]));
        let coarse = setup.geometry(None, [2.0, 4.0, 1.0]);
        assert_eq!((coarse.spacing, coarse.origin), ([1.0, 1.0, 2.0], [0.25, 0.375, 0.0]));
    }

    #[test]
    fn transforms_are_applied_from_the_last_to_the_first() {
        let registered = "<ViewRegistrations><ViewRegistration timepoint=\"3\" setup=\"7\">\
            <ViewTransform type=\"affine\"><affine>1 0 0 10 0 1 0 20 0 0 1 30</affine></ViewTransform>\
            <ViewTransform type=\"affine\"><affine>0 -2 0 1 2 0 0 0 0 0 3 0</affine></ViewTransform>\
            </ViewRegistration></ViewRegistrations>";
        let found = Described::parse(&xml(registered)).expect("a data set");
        let view = View { setup: &found.setups[0], time: 3 };
        let place = found.place_of(view).expect("a place");
        // Voxel (1, 2, 3): rotated and scaled to (-4 + 1, 2, 9), then translated.
        assert_eq!(place.transform_point3(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(7.0, 22.0, 39.0));
        let geometry = view.setup.geometry(Some(place), [1.0; 3]);
        assert_eq!((geometry.spacing, geometry.origin), ([2.0, 2.0, 3.0], [11.0, 20.0, 30.0]));
        assert_eq!(geometry.direction, [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let at = geometry.world_from_index().transform_point3(DVec3::new(1.0, 2.0, 3.0));
        assert!((at - DVec3::new(7.0, 22.0, 39.0)).length() < 1e-12, "{at}");
        assert!(found.place_of(View { time: 4, ..view }).is_none());
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for (wrong, words) in [
            ("<ViewSetup><id>x</id></ViewSetup>", "whole number"),
            ("<ViewSetup><voxelSize><size>1 2</size></voxelSize></ViewSetup>", "3 numbers"),
            ("<ViewSetup><voxelSize><size>1 0 1</size></voxelSize></ViewSetup>", "voxels of"),
            ("<ViewRegistration setup=\"1\"/>", "no timepoint"),
            ("<ViewTransform><affine>1 2 3</affine></ViewTransform>", "12 numbers"),
            ("<a></b>", ""),
        ] {
            let found = Described::parse(&xml(wrong)).expect_err(wrong);
            assert!(found.contains(words), "{wrong}: {found}");
        }
        let deep = "<a>".repeat(DEPTH_LIMIT + 1);
        assert!(Described::parse(&deep).is_err());
    }
}
