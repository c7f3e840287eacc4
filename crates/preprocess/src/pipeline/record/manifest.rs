//! Manifest of a container: origin of the voxels, options of the build, statistics, notes of the reader.
//!
//! Names, units and notes come from files. Their length and number are limited here, so that no file makes a manifest
//! that readers refuse.

use supervol_format::VoxelType;
use supervol_format::container::manifest::{AxisName, Json, Manifest, Source};
use supervol_sources::{Message, SourceInfo};

use crate::pipeline::options::Reduce;
use crate::pipeline::plan::BuildPlan;
use crate::pipeline::plan::labels::Labels;
use crate::pipeline::plan::lod_axes::LevelPlan;
use crate::pipeline::plan::max_error::MaxError;
use crate::report::LevelReport;
use crate::statistics::{self, Form, LABELS, Statistics, Values};

/// Limits of the manifest: characters of a name or unit, characters of a note, number of notes.
const LABEL_CHARACTERS: usize = 256;
const NOTE_CHARACTERS: usize = 500;
const NOTES: usize = 50;

/// Parameter with the operation that makes one voxel of several in coarser levels.
const REDUCE: &str = "reduce";
/// Prefix of the parameters that say how files were read.
const READER: &str = "reader_";
/// Parameter with the measurements that chose the halved axes.
const RMS_KEPT: &str = "lod_axes_rms_kept";
/// Parameter with the kind of data that the caller named.
const KIND: &str = "kind";
/// Parameter with the steps to which means in coarser levels are rounded.
const STEPS: &str = "coarse_steps";

/// Operation that made the coarser levels of a container with this manifest. Without the parameter it is the mean.
///
/// # Errors
/// With the parameter's text, if it names none of [`Reduce::ALL`].
pub fn reduce_of(manifest: &Manifest) -> Result<Reduce, String> {
    let Some(name) = manifest.parameters.get(REDUCE) else { return Ok(Reduce::Mean) };
    Reduce::ALL.into_iter().find(|reduce| reduce.name() == name).ok_or_else(|| name.clone())
}

/// Steps to which means are rounded in the levels from 1 on, in stored units. Empty or 0 if means are not rounded.
///
/// # Errors
/// With the parameter's text, if it holds no steps of this voxel type.
pub fn steps_of(manifest: &Manifest, voxel_type: VoxelType) -> Result<Vec<f64>, String> {
    let Some(text) = manifest.parameters.get(STEPS) else { return Ok(Vec::new()) };
    LevelPlan::steps_from(text, voxel_type).ok_or_else(|| text.clone())
}

/// Share of the previous level that halving each axis would keep ([`LevelPlan::rms_kept_from`]). `None` without the
/// parameter.
#[must_use]
pub fn rms_kept_of(manifest: &Manifest) -> Option<Vec<[f64; 3]>> {
    LevelPlan::rms_kept_from(manifest.parameters.get(RMS_KEPT)?)
}

/// Manifest of a container whose levels are written.
pub(crate) fn manifest(
    info: &SourceInfo,
    origin: Source,
    plan: &BuildPlan<'_>,
    statistics: &Statistics,
    levels: &[LevelReport],
) -> Manifest {
    let BuildPlan { options, descriptor, levels: axes, .. } = plan;
    let form = if plan.labels == Labels::None { Form::Resolved } else { Form::Labels };
    let values = Values::of(descriptor, statistics, form);
    let codec = options.codec.name();
    // Manifests of exact containers do not have this parameter.
    let max_error = (options.max_error != MaxError::Exact).then(|| ("max_error", options.max_error.describe()));
    let rms_kept = axes.describe().map(|kept| (RMS_KEPT, kept));
    let steps = axes.describe_steps().map(|steps| (STEPS, steps));
    let kind = options.kind.clone().map(|kind| (KIND, kind));
    let labels = plan.labels.because().map(|because| (LABELS, because.into()));
    let reading = info.reading.iter().map(|(option, said)| (format!("{READER}{option}"), said.clone()));
    let parameters = [
        ("brick", options.layout.core().to_string()),
        ("codec", codec.to_string()),
        ("lod_axes", format!("{:?}", options.lod_axes).to_lowercase()),
        ("memory_bytes", options.memory_bytes.to_string()),
        (REDUCE, plan.reduce.name().to_string()),
    ];
    Manifest {
        tool: format!("supervol {}", env!("CARGO_PKG_VERSION")),
        parameters: parameters
            .into_iter()
            .chain(max_error)
            .chain(kind)
            .chain(labels)
            .chain(rms_kept)
            .chain(steps)
            .map(|(k, v)| (k.to_string(), v))
            .chain(reading)
            .collect(),
        source: origin,
        space: info.space.name().into(),
        axes: info.axes.clone().map(|a| AxisName { name: label(&a.name), unit: label(&a.unit) }),
        unit: label(&info.unit),
        value_range: values.range,
        present_voxels: values.present,
        histogram: values.histogram,
        percentiles: values.percentiles,
        distribution: values.distribution,
        level_errors: levels.iter().map(|l| statistics::finite(l.error)).collect(),
        survey: info.survey.as_ref().and_then(|s| serde_json::to_value(s).and_then(|s| Json::of(&s)).ok()),
        notes: bounded_notes(&info.notes).into_iter().chain(values.note).collect(),
        others: std::collections::BTreeMap::default(),
    }
}

/// A name or unit from a file, cut to the limit.
fn label(text: &str) -> String {
    cut(text, LABEL_CHARACTERS)
}

fn cut(text: &str, characters: usize) -> String {
    match text.char_indices().nth(characters) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// The first notes, each cut to the limit, and the number of further ones.
pub(crate) fn bounded_notes(notes: &[Message]) -> Vec<String> {
    let mut kept: Vec<String> = notes.iter().take(NOTES).map(|note| cut(&note.to_string(), NOTE_CHARACTERS)).collect();
    if notes.len() > NOTES {
        kept.push(format!("and {} more notes", notes.len() - NOTES));
    }
    kept
}
