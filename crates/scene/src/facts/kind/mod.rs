//! Recognition of the kind of data from the file's metadata (format, space, name, unit) and values (histogram,
//! percentiles).
//!
//! The kind decides the default picture and nothing else. Rules are tried from the most to the least reliable. The
//! first rule that holds wins and gives its reason. Limits are in the field's own units or shares of the value range.

use std::str::FromStr;

use supervol_format::container::manifest::{Manifest, percentile_of};
use supervol_format::readable::Number;
use supervol_format::space::WorldSpace;
use supervol_format::{Container, ValueRange, VoxelType};

use super::histogram::Histogram;

/// Kind of data in a volume. It decides only the default picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DataKind {
    /// Seismic amplitudes: signed, zero is neutral, z points down.
    Seismic,
    /// Survey quantity of one sign: velocity, impedance, coherence.
    SeismicAttribute,
    /// Computed tomography in Hounsfield units.
    Ct,
    /// Computed tomography in Hounsfield units with 1024 added.
    CtOffset,
    /// Magnetic resonance, and other images of patients.
    Mri,
    /// A few bright voxels on a dark background: fluorescence, angiography.
    Fluorescence,
    /// Grey everywhere, without a background: electron microscopy.
    ElectronMicroscopy,
    /// Solid matter in air: micro-CT of rock, plants, materials.
    MicroCt,
    /// Numbers that name objects.
    Labels,
    /// Two values: inside and outside.
    Mask,
    /// The same value everywhere.
    Constant,
    /// No present voxel.
    Empty,
    /// Anything else.
    #[default]
    Generic,
}

impl DataKind {
    /// All kinds.
    pub const ALL: [Self; 13] = [
        Self::Seismic,
        Self::SeismicAttribute,
        Self::Ct,
        Self::CtOffset,
        Self::Mri,
        Self::Fluorescence,
        Self::ElectronMicroscopy,
        Self::MicroCt,
        Self::Labels,
        Self::Mask,
        Self::Constant,
        Self::Empty,
        Self::Generic,
    ];

    /// The kind's name; its preset has the same name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Seismic => "seismic",
            Self::SeismicAttribute => "attribute",
            Self::Ct => "ct",
            Self::CtOffset => "ct-offset",
            Self::Mri => "mri",
            Self::Fluorescence => "fluorescence",
            Self::ElectronMicroscopy => "em",
            Self::MicroCt => "micro-ct",
            Self::Labels => "labels",
            Self::Mask => "mask",
            Self::Constant => "constant",
            Self::Empty => "empty",
            Self::Generic => "generic",
        }
    }

    /// Whether z is depth or time below a survey.
    #[must_use]
    pub fn is_seismic(self) -> bool {
        matches!(self, Self::Seismic | Self::SeismicAttribute)
    }
}

impl FromStr for DataKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let names: Vec<&str> = Self::ALL.iter().map(|kind| kind.name()).collect();
            format!("'{name}': expected one of {}", names.join(", "))
        })
    }
}

/// A recognised kind and the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Recognised {
    /// The kind.
    pub kind: DataKind,
    /// The reason, as the end of a sentence.
    pub because: String,
}

/// Most different labels, and the greatest label.
const LABELS: u64 = 40;
const LABEL_LIMIT: f64 = 255.0;
/// Least average number of voxels per label; with fewer, the values are noise.
const VOXELS_PER_LABEL: u64 = 64;
/// Hounsfield units: values of air, and the greatest possible range.
const AIR: [f64; 2] = [-1100.0, -850.0];
const HOUNSFIELD: [f64; 2] = [-3100.0, 32_767.0];
/// Fat, water and muscle in Hounsfield units plus 1024, and the gap between these and lungs.
const SOFT_WITH_OFFSET: [f64; 2] = [880.0, 1120.0];
const GAP_WITH_OFFSET: [f64; 2] = [350.0, 800.0];

/// Amplitudes are roughly symmetric: the shorter side reaches at least this share of the longer side.
const SYMMETRY: f64 = 0.3;

/// The kind of a container's data and the reason.
#[must_use]
pub fn recognise(container: &Container) -> Recognised {
    let descriptor = container.descriptor();
    let whole = descriptor.scale == 1.0 && descriptor.offset.fract() == 0.0;
    let integral = whole && !matches!(descriptor.voxel_type, VoxelType::F32 | VoxelType::F64);
    Evidence::new(container.manifest(), integral).recognise()
}

/// The evidence from which the kind is recognised.
struct Evidence<'a> {
    manifest: &'a Manifest,
    /// Range of all values.
    all: ValueRange,
    /// Range of the central values, their histogram and percentiles.
    range: ValueRange,
    histogram: Histogram<'a>,
    percentiles: &'a [[f64; 2]],
    /// Whether all values are whole numbers.
    integral: bool,
}

impl<'a> Evidence<'a> {
    fn new(manifest: &'a Manifest, integral: bool) -> Self {
        let all = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 0.0 });
        let (range, histogram, percentiles) = match manifest.central() {
            Some(central) => (central.range, &central.histogram, &central.percentiles),
            None => (all, &manifest.histogram, &manifest.percentiles),
        };
        Self { manifest, all, range, histogram: Histogram::new(histogram, range), percentiles, integral }
    }

    fn recognise(&self) -> Recognised {
        let rules = [
            Self::degenerate,
            Self::named,
            Self::seismic,
            Self::few_values,
            Self::tomography,
            Self::patient,
            Self::image,
        ];
        let found = rules.iter().find_map(|rule| rule(self));
        let (kind, because) =
            found.unwrap_or((DataKind::Generic, "nothing says what it is, and its values do not either".into()));
        Recognised { kind, because }
    }

    fn percentile(&self, percent: f64) -> f64 {
        percentile_of(self.percentiles, percent).unwrap_or(self.range.min)
    }

    /// Whether one of the words is part of the file's name. Words are separated by anything but letters and digits.
    fn name_says(&self, words: &[&str]) -> bool {
        let name = self.manifest.source.name.to_lowercase();
        name.split(|c: char| !c.is_alphanumeric()).any(|part| words.contains(&part))
    }

    fn degenerate(&self) -> Option<(DataKind, String)> {
        if self.manifest.value_range.is_none() {
            return Some((DataKind::Empty, "no voxel is present".into()));
        }
        (self.range.width() <= 0.0).then(|| (DataKind::Constant, format!("every voxel is {}", Number(self.range.min))))
    }

    /// The kind that was named or recognised when the container was built.
    fn named(&self) -> Option<(DataKind, String)> {
        let parameters = &self.manifest.parameters;
        if let Some(kind) = parameters.get("kind").and_then(|name| name.parse().ok()) {
            return Some((kind, "named when the container was built".into()));
        }
        parameters.get("labels").map(|because| (DataKind::Labels, because.clone()))
    }

    fn seismic(&self) -> Option<(DataKind, String)> {
        let source = &self.manifest.source;
        let computed = source.format == "synth" && source.name.starts_with("seismic");
        if source.format != "segy" && !computed {
            return None;
        }
        let (low, high) = (self.percentile(1.0), self.percentile(99.0));
        let what = if computed { "a synthetic survey" } else { "a SEG-Y file" };
        let smaller = low.abs().min(high.abs());
        if low < 0.0 && high > 0.0 && smaller >= SYMMETRY * low.abs().max(high.abs()) {
            return Some((DataKind::Seismic, format!("{what} with values about as far below zero as above")));
        }
        let centre = 0.5 * self.range.min + 0.5 * self.range.max;
        let median_in_the_middle = (self.percentile(50.0) - centre).abs() <= 0.05 * self.range.width();
        if self.integral && self.range.min >= 0.0 && self.range.max <= 65_535.0 && median_in_the_middle {
            return Some((DataKind::Seismic, format!("{what} with whole numbers around {centre}, taken for zero")));
        }
        Some((DataKind::SeismicAttribute, format!("{what} with values of one sign, or nearly")))
    }

    fn few_values(&self) -> Option<(DataKind, String)> {
        let Self { all, manifest, .. } = self;
        let used = self.different_values();
        let is_end = |value: f64| value == all.min || value == all.max;
        if used == 2 && manifest.percentiles.iter().all(|pair| is_end(pair[1])) {
            let because = format!("every voxel is {} or {}", Number(all.min), Number(all.max));
            return Some((DataKind::Mask, because));
        }
        // Newer containers say whether they hold labels. Bins narrower than 1 hold at most one whole number each.
        let labels = manifest.distribution.is_none()
            && self.integral
            && all.min >= 0.0
            && all.max <= LABEL_LIMIT
            && (2..=LABELS).contains(&used)
            && manifest.present_voxels >= VOXELS_PER_LABEL * used;
        labels.then(|| (DataKind::Labels, format!("{used} different whole numbers from {} on", all.min)))
    }

    /// Number of different values: counted, or that of used bins in containers without a distribution.
    fn different_values(&self) -> u64 {
        match &self.manifest.distribution {
            Some(distribution) => distribution.distinct_values.unwrap_or(u64::MAX),
            None => self.histogram.bins_used() as u64,
        }
    }

    fn tomography(&self) -> Option<(DataKind, String)> {
        let Self { range, histogram, .. } = self;
        let says_ct = self.manifest.unit == "HU";
        let reaches = range.min <= -500.0 && range.min >= HOUNSFIELD[0] && (400.0..=HOUNSFIELD[1]).contains(&range.max);
        let air = histogram.share_between(AIR[0], AIR[1]);
        if says_ct || reaches && air >= 0.005 {
            let because =
                format!("values from {range}, {:.0} % of them near -1000 like air in Hounsfield units", 100.0 * air);
            return Some((DataKind::Ct, because));
        }
        let soft = histogram.share_between(SOFT_WITH_OFFSET[0], SOFT_WITH_OFFSET[1]);
        let gap = histogram.share_between(GAP_WITH_OFFSET[0], GAP_WITH_OFFSET[1]);
        let with_offset = self.integral && range.min >= 0.0 && (1400.0..=8191.0).contains(&range.max);
        (with_offset && soft >= 0.08 && gap < soft / 2.0).then(|| {
            let because = format!(
                "whole numbers from {range}, {:.0} % of them near 1024 like soft tissue in Hounsfield units with 1024 added",
                100.0 * soft
            );
            (DataKind::CtOffset, because)
        })
    }

    fn patient(&self) -> Option<(DataKind, String)> {
        if WorldSpace::from_name(&self.manifest.space) == WorldSpace::Unknown {
            return None;
        }
        if self.name_says(&["ct", "cbct"]) && self.range.min >= 0.0 {
            return Some((DataKind::Ct, "its name says ct, though its values are no Hounsfield units".into()));
        }
        let because = || "the image of a patient, by its space, and no computed tomography".into();
        (self.percentile(1.0) >= 0.0).then(|| (DataKind::Mri, because()))
    }

    fn image(&self) -> Option<(DataKind, String)> {
        let Self { range, histogram, .. } = self;
        if self.percentile(0.1) < 0.0 {
            return None;
        }
        let at = |percent: f64| (self.percentile(percent) - range.min) / range.width();
        if at(50.0) <= 0.1 && at(99.0) <= 0.35 {
            let because = format!("99 % of the voxels are darker than {:.0} % of the greatest value", 100.0 * at(99.0));
            return Some((DataKind::Fluorescence, because));
        }
        if !self.integral {
            return None;
        }
        if histogram.fullest() <= 0.10 && (0.2..=0.8).contains(&at(50.0)) && at(75.0) - at(25.0) <= 0.6 {
            let because = "whole numbers, grey throughout, and no value for background".into();
            return Some((DataKind::ElectronMicroscopy, because));
        }
        let is_dark = at(50.0) <= 0.15 || histogram.fullest() >= 0.3;
        let found = if self.is_one_of_several_channels() {
            (DataKind::Fluorescence, "one of several channels, with something bright in the dark".into())
        } else {
            (DataKind::MicroCt, "whole numbers, most of them dark background around something denser".into())
        };
        is_dark.then_some(found)
    }

    /// Whether the file holds other channels beside the one that was read. This is usual for microscopes, not for
    /// scanners of solid matter. If the user chose the channel, the choice is part of the name; otherwise the reader
    /// writes a note, with the option's name in the library or on the command line.
    fn is_one_of_several_channels(&self) -> bool {
        let names_option = |note: &String| note.contains("`channel`") || note.contains("--channel");
        let is_noted = |note: &String| note.contains(" channels") && names_option(note);
        self.manifest.source.name.contains(" --channel ") || self.manifest.notes.iter().any(is_noted)
    }
}

#[cfg(test)]
mod tests;
