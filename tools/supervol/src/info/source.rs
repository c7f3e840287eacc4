//! Description of a volume file: all facts that are known before its voxels are read.

use std::io::Write;
use std::path::{Path, PathBuf};

use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::quantity::show_bytes;
use supervol_arguments::source::flag;
use supervol_arguments::terminal::Format;
use supervol_format::readable::Shortened;
use supervol_preprocess::BuildError;
use supervol_preprocess::kept::Reading;
use supervol_preprocess::naming::container_beside;
use supervol_scene::facts::kind::Certainty;
use supervol_sources::grid::named::NamedSource;
use supervol_sources::input::file::SourceFile;
use supervol_sources::{SourceInfo, Survey, VolumeSource};

use super::Place;

/// Memory limit of a reader, bytes.
pub const MEMORY_BYTES: u64 = 1 << 30;

/// Open volume file.
pub struct Described {
    path: PathBuf,
    source: Box<dyn VolumeSource>,
}

impl Described {
    /// Opens a volume file. Its voxels are read only if the file is compressed as a whole.
    pub fn of(path: &Path, reading: &Reading) -> Result<Self, Failure> {
        let source = reading.open(path, &std::env::temp_dir()).map_err(BuildError::from)?;
        let source = Box::new(NamedSource::new(source, flag));
        Ok(Self { path: path.into(), source })
    }

    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn name(&self) -> String {
        self.path.file_name().unwrap_or(self.path.as_os_str()).to_string_lossy().into_owned()
    }

    /// Total bytes of all files of the volume.
    fn bytes(&self) -> u64 {
        self.info().files.iter().map(SourceFile::bytes).sum()
    }

    /// Lines and corners of a survey.
    pub fn survey(&self) -> Option<&Survey> {
        self.info().survey.as_ref()
    }

    /// JSON object with the keys of `info` for containers, as far as they are known.
    pub fn to_json(&self) -> serde_json::Value {
        let info = self.info();
        let axis = |axis: &supervol_sources::Axis| serde_json::json!({ "name": axis.name, "unit": axis.unit });
        let mut described = serde_json::json!({
            "dims": info.dims.0,
            "spacing": info.geometry.spacing,
            "origin": info.geometry.origin,
            "direction": info.geometry.direction,
            "left_handed": info.geometry.is_left_handed(),
            "space": info.space.name(),
            "dtype": info.voxel_type.name(),
            "scale": info.scale,
            "offset": info.offset,
            "unit": info.unit,
            "axes": info.axes.each_ref().map(axis),
            "nodata": info.nodata.map(|stored| stored * info.scale + info.offset),
            "source": { "name": self.name(), "format": info.format, "bytes": self.bytes() },
            "survey": info.survey,
            "notes": info.notes.iter().map(ToString::to_string).collect::<Vec<_>>(),
        });
        // Other kinds are known once the container is built.
        if let Some(because) = info.labels {
            described["kind"] = "labels".into();
            described["kind_because"] = because.into();
            described["kind_certainty"] = Certainty::Certain.name().into();
        }
        described
    }

    /// Prints the description on standard output.
    pub fn print(&self, format: Format) -> Result<(), Failure> {
        let mut out = supervol_arguments::terminal::stdout();
        let printed = match format {
            Format::Text => self.print_text(&mut out),
            Format::Json => writeln!(out, "{:#}", self.to_json()),
        };
        printed.map_err(with_output)
    }

    fn print_text(&self, out: &mut impl Write) -> std::io::Result<()> {
        let info = self.info();
        let place = Place {
            dims: info.dims,
            dtype: info.voxel_type.name(),
            axes: info.axes.each_ref().map(|axis| (&*axis.name, &*axis.unit)),
            geometry: &info.geometry,
            space: info.space.name(),
            survey: self.survey(),
        };
        place.print(out)?;
        if let Some(because) = info.labels {
            writeln!(out, "kind       labels: {because}")?;
        }
        if let Some(stored) = info.nodata {
            let value = stored * info.scale + info.offset;
            writeln!(out, "no data    {}", Shortened::data(value, info.voxel_type, [info.scale, info.offset]))?;
        }
        writeln!(out, "source     {} ({}, {})", self.name(), info.format, show_bytes(self.bytes()))?;
        for note in &info.notes {
            writeln!(out, "note       {note}")?;
        }
        let built = container_beside(&self.path);
        writeln!(
            out,
            "container  none; {} unknown until it is built: `supervol build` makes {}",
            if info.labels.is_some() { "values are" } else { "kind and values are" },
            built.display()
        )
    }
}
