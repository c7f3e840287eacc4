//! The manifest: a description of the data and its origin, in JSON near the end of a container. It holds no dates,
//! paths or host names, so that the same input and options give the same bytes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::ValueRange;

/// Largest size of a manifest in bytes, about ten times that of the largest known one. Parsed JSON takes up to a
/// hundred times its size, so no manifest takes more than 25 MiB of memory.
pub const BYTES_LIMIT: u64 = 256 << 10;

/// Most labels that a manifest lists.
pub const LABELS_LISTED: usize = 1000;

/// The manifest of a container. Values are data values: scale and offset applied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The program that wrote the container: `supervol VERSION`.
    pub tool: String,
    /// Options that influenced the bytes, by name.
    pub parameters: BTreeMap<String, String>,
    /// Origin of the voxels.
    pub source: Source,
    /// Meaning of the world axes, as named by [`crate::space::WorldSpace::name`]; empty if unknown.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub space: String,
    /// Names and units of the axes x, y, z.
    pub axes: [AxisName; 3],
    /// Unit of the values; empty if unknown.
    pub unit: String,
    /// Range of all present voxels of level 0; null if none is present.
    pub value_range: Option<ValueRange>,
    /// Number of present voxels of level 0.
    pub present_voxels: u64,
    /// Number of present voxels in each bin; the bins divide `value_range` into equal parts.
    pub histogram: Vec<u64>,
    /// `[percent, value]` pairs, ascending.
    pub percentiles: Vec<[f64; 2]>,
    /// Further statistics of level 0. Containers of release 0.1.0 have none, and their percentiles are approximate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distribution: Option<Distribution>,
    /// Largest error bound of each level, level 0 first, in data units.
    pub level_errors: Vec<f64>,
    /// Geometry of a seismic survey, or null.
    pub survey: Option<Json>,
    /// Observations of the source's reader, one sentence each.
    pub notes: Vec<String>,
    /// Fields that this program does not know, as stored in the file. Later writers may add fields that readers may
    /// ignore. Fields that must not be ignored raise the format version.
    #[serde(flatten)]
    pub others: BTreeMap<String, serde_json::Value>,
}

/// Distribution of the present values of level 0, in data units.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Distribution {
    /// Number of different values; null if there were too many to count.
    pub distinct_values: Option<u64>,
    /// Values without those that lie far from all others; null if no value does.
    pub central: Option<Central>,
    /// The labels that occur, ascending. Only for volumes of labels with at most [`LABELS_LISTED`] different ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<f64>,
}

/// Statistics of the values without those that lie far from all others: outliers, and numbers that stand for "no value".
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Central {
    /// Range of the central values.
    pub range: ValueRange,
    /// Number of voxels below this range.
    pub below: u64,
    /// Number of voxels above this range.
    pub above: u64,
    /// Number of central voxels in each bin; the bins divide `range` into equal parts.
    pub histogram: Vec<u64>,
    /// `[percent, value]` pairs of the central voxels, ascending.
    pub percentiles: Vec<[f64; 2]>,
}

/// JSON that is parsed only on request: parsed, it would take up to a hundred times its size in every command.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Json(Box<RawValue>);

impl Json {
    /// Serializes a value.
    ///
    /// # Errors
    /// If the value has no JSON form.
    pub fn of(value: &impl Serialize) -> Result<Self, serde_json::Error> {
        serde_json::value::to_raw_value(value).map(Self)
    }

    /// The parsed value.
    ///
    /// # Panics
    /// Never: the text was checked when it was read.
    #[must_use]
    pub fn value(&self) -> serde_json::Value {
        serde_json::from_str(self.0.get()).expect("a raw value is JSON")
    }
}

impl PartialEq for Json {
    fn eq(&self, other: &Self) -> bool {
        self.0.get() == other.0.get()
    }
}

/// Source file of a container.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// File name without its folder, or the name of a synthetic volume.
    pub name: String,
    /// Name of the file format, such as `raw`, `nrrd` or `segy`; `synth` for a computed volume.
    pub format: String,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// XXH3-64 of the file, 16 hexadecimal digits; empty for synthetic volumes.
    pub xxh3_64: String,
}

impl Source {
    /// Source entry of a computed volume: no file, no checksum.
    #[must_use]
    pub fn computed(name: impl Into<String>) -> Self {
        Self { name: name.into(), format: "synth".into(), bytes: 0, xxh3_64: String::new() }
    }
}

/// Name and unit of one axis.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AxisName {
    /// Name, such as `x` or `inline`.
    pub name: String,
    /// Unit of the spacing along the axis.
    pub unit: String,
}

impl Manifest {
    /// The manifest as JSON.
    ///
    /// # Errors
    /// If the JSON is longer than [`BYTES_LIMIT`], or [`Self::from_json`] refuses it.
    pub fn to_json(&self) -> Result<Vec<u8>, String> {
        let json = serde_json::to_vec(self).map_err(|e| e.to_string())?;
        Self::from_json(&json)?;
        Ok(json)
    }

    /// Parses a manifest.
    ///
    /// # Errors
    /// If it is longer than [`BYTES_LIMIT`], or no manifest.
    pub fn from_json(json: &[u8]) -> Result<Self, String> {
        if json.len() as u64 > BYTES_LIMIT {
            return Err(format!("{} bytes, expected at most {BYTES_LIMIT}", json.len()));
        }
        serde_json::from_slice(json).map_err(|e| e.to_string())
    }

    /// Statistics of the central values, if some values lie far from all others.
    #[must_use]
    pub fn central(&self) -> Option<&Central> {
        self.distribution.as_ref()?.central.as_ref()
    }

    /// Data value below which `percent` (0 to 100) of the present voxels lie, interpolated between the stored pairs.
    /// `None` if there are no pairs.
    #[must_use]
    pub fn percentile(&self, percent: f64) -> Option<f64> {
        percentile_of(&self.percentiles, percent)
    }
}

/// Value at a percentage, interpolated between `[percent, value]` pairs, which ascend. `None` if there are no pairs.
#[must_use]
pub fn percentile_of(pairs: &[[f64; 2]], percent: f64) -> Option<f64> {
    let first = pairs.first()?;
    Some(match pairs.iter().position(|p| p[0] >= percent) {
        None => pairs.last()?[1],
        Some(0) => first[1],
        Some(i) => {
            let ([p0, v0], [p1, v1]) = (pairs[i - 1], pairs[i]);
            v0 + (v1 - v0) * (percent - p0) / (p1 - p0)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: &str = r#"{"tool":"supervol 0","parameters":{},"source":{"name":"n","format":"raw","bytes":3,"xxh3_64":""},
        "axes":[{"name":"x","unit":""},{"name":"y","unit":""},{"name":"z","unit":""}],"unit":"","value_range":null,
        "present_voxels":0,"histogram":[],"percentiles":[],"level_errors":[0.1],"survey":null,"notes":[]"#;

    #[test]
    fn unknown_fields_are_kept_and_missing_ones_refused() {
        let later = format!(r#"{KNOWN},"time_steps":3,"channels":[{{"name":"c","deep":{{"x":0.1}}}}]}}"#);
        let manifest: Manifest = serde_json::from_str(&later).expect("a manifest");
        assert_eq!(manifest.others["time_steps"], 3);
        let again = serde_json::to_string(&manifest).expect("it is text");
        assert_eq!(serde_json::from_str::<Manifest>(&again).expect("a manifest"), manifest);
        assert!(again.contains(r#""deep":{"x":0.1}"#), "{again}");
        let present: Manifest = serde_json::from_str(&format!("{KNOWN}}}")).expect("a manifest");
        assert!(present.others.is_empty() && !serde_json::to_string(&present).expect("it is text").contains("others"));
        // Unknown fields inside parts are accepted, too.
        let with_part = KNOWN.replace(r#""bytes":3"#, r#""bytes":3,"modified":"then""#);
        assert!(serde_json::from_str::<Manifest>(&format!("{with_part}}}")).is_ok());
        let without = KNOWN.replace(r#""tool":"supervol 0","#, "");
        assert!(serde_json::from_str::<Manifest>(&format!("{without}}}")).is_err());
    }
}
