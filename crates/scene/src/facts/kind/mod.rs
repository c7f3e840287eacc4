//! Recognition of the kind of data from the file's metadata (format, space, name, unit) and values (histogram,
//! percentiles).
//!
//! The kind decides the default picture and nothing else. Rules are tried from the most to the least reliable. The
//! first rule that holds wins and gives its reason and its [`Certainty`]. Without evidence the kind is
//! [`DataKind::Generic`], whose picture suits everything. Limits are in the field's own units or shares of the value
//! range.

use std::str::FromStr;

use supervol_format::container::manifest::{Manifest, percentile_of};
use supervol_format::readable::Number;
use supervol_format::space::WorldSpace;
use supervol_format::{Container, Dims, ValueRange, VoxelType};

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
    /// Strength of the evidence.
    pub certainty: Certainty,
}

/// Strength of the evidence for a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// Only the values' histogram speaks for it, or nothing does.
    Guess,
    /// The file's format, space or name speaks for it, and the values agree.
    Likely,
    /// The file or the user says so, or each voxel was looked at.
    Certain,
}

impl Certainty {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Guess => "guess",
            Self::Likely => "likely",
            Self::Certain => "certain",
        }
    }
}

/// Kind, reason and strength of the evidence that a rule finds.
type Found = (DataKind, String, Certainty);

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

/// Fewest voxels whose histogram tells a kind.
const FEWEST_VOXELS: u64 = 2048;
/// Fewest voxels along each edge of an image stack.
const FEWEST_ALONG: u64 = 8;
/// Parameter of a manifest with the modality that a DICOM file names.
const MODALITY: &str = "reader_modality";
/// Formats of microscopes.
const OF_MICROSCOPES: [&str; 3] = ["ome-zarr", "bdv", "n5"];
/// Words in names of magnetic resonance images.
const OF_RESONANCE: [&str; 12] =
    ["mr", "mri", "t1", "t2", "t1w", "t2w", "t1c", "flair", "mprage", "brain", "fmri", "dwi"];

/// Amplitudes are roughly symmetric: the shorter side reaches at least this share of the longer side.
const SYMMETRY: f64 = 0.3;

/// The kind of a container's data and the reason.
#[must_use]
pub fn recognise(container: &Container) -> Recognised {
    let descriptor = container.descriptor();
    let whole = descriptor.scale == 1.0 && descriptor.offset.fract() == 0.0;
    let integral = whole && !matches!(descriptor.voxel_type, VoxelType::F32 | VoxelType::F64);
    Evidence::new(container.manifest(), descriptor.dims(), integral).recognise()
}

/// The evidence from which the kind is recognised.
struct Evidence<'a> {
    manifest: &'a Manifest,
    dims: Dims,
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
    fn new(manifest: &'a Manifest, dims: Dims, integral: bool) -> Self {
        let all = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 0.0 });
        let (range, histogram, percentiles) = match manifest.central() {
            Some(central) => (central.range, &central.histogram, &central.percentiles),
            None => (all, &manifest.histogram, &manifest.percentiles),
        };
        Self { manifest, dims, all, range, histogram: Histogram::new(histogram, range), percentiles, integral }
    }

    fn recognise(&self) -> Recognised {
        let rules = [
            Self::degenerate,
            Self::named,
            Self::seismic,
            Self::few_values,
            Self::tomography,
            Self::modality,
            Self::few_voxels,
            Self::patient,
            Self::by_name,
            Self::image,
        ];
        let nothing = || {
            let because = "nothing says what it is, and its values do not either".into();
            (DataKind::Generic, because, Certainty::Guess)
        };
        let (kind, because, certainty) = rules.iter().find_map(|rule| rule(self)).unwrap_or_else(nothing);
        Recognised { kind, because, certainty }
    }

    fn percentile(&self, percent: f64) -> f64 {
        percentile_of(self.percentiles, percent).unwrap_or(self.range.min)
    }

    /// The word among `words` that is part of the file's name. Words are separated by anything but letters and digits,
    /// and begin at capital letters, as in `HeadMRVolume`.
    fn name_says<'w>(&self, words: &[&'w str]) -> Option<&'w str> {
        let name = &self.manifest.source.name;
        let parts = name.split(|c: char| !c.is_alphanumeric());
        let parts = parts.flat_map(|part| capitalised(part).chain([part]));
        let mut found = parts.filter_map(|part| words.iter().copied().find(|word| part.eq_ignore_ascii_case(word)));
        found.next()
    }

    /// Whether the file's format is one of microscopes.
    fn is_of_a_microscope(&self) -> bool {
        let name = self.manifest.source.name.to_lowercase();
        OF_MICROSCOPES.contains(&self.manifest.source.format.as_str())
            || name.contains(".ome.")
            || self.is_one_of_several_channels()
    }

    fn degenerate(&self) -> Option<Found> {
        if self.manifest.value_range.is_none() {
            return Some((DataKind::Empty, "no voxel is present".into(), Certainty::Certain));
        }
        let because = || format!("every voxel is {}", Number(self.range.min));
        (self.range.width() <= 0.0).then(|| (DataKind::Constant, because(), Certainty::Certain))
    }

    /// The kind that was named or recognised when the container was built.
    fn named(&self) -> Option<Found> {
        let parameters = &self.manifest.parameters;
        if let Some(kind) = parameters.get("kind").and_then(|name| name.parse().ok()) {
            return Some((kind, "named when the container was built".into(), Certainty::Certain));
        }
        let because = parameters.get("labels")?;
        // Unless the file or the user said so, samples of the voxels did.
        let certainty = if because.starts_with("whole numbers") { Certainty::Likely } else { Certainty::Certain };
        Some((DataKind::Labels, because.clone(), certainty))
    }

    fn seismic(&self) -> Option<Found> {
        let Manifest { source, survey, .. } = self.manifest;
        let computed = source.format == "synth" && source.name.starts_with("seismic");
        let what = if computed {
            "a synthetic survey"
        } else if source.format == "segy" {
            "a SEG-Y file"
        } else if survey.is_some() {
            "lines of a survey"
        } else {
            return None;
        };
        let found = |kind, end: String| Some((kind, format!("{what} with {end}"), Certainty::Likely));
        let (low, high) = (self.percentile(1.0), self.percentile(99.0));
        let smaller = low.abs().min(high.abs());
        if low < 0.0 && high > 0.0 && smaller >= SYMMETRY * low.abs().max(high.abs()) {
            return found(DataKind::Seismic, "values about as far below zero as above".into());
        }
        let centre = 0.5 * self.range.min + 0.5 * self.range.max;
        let median_in_the_middle = (self.percentile(50.0) - centre).abs() <= 0.05 * self.range.width();
        if self.integral && self.range.min >= 0.0 && self.range.max <= 65_535.0 && median_in_the_middle {
            return found(DataKind::Seismic, format!("whole numbers around {centre}, taken for zero"));
        }
        found(DataKind::SeismicAttribute, "values of one sign, or nearly".into())
    }

    fn few_values(&self) -> Option<Found> {
        let Self { all, manifest, .. } = self;
        let used = self.different_values();
        let is_end = |value: f64| value == all.min || value == all.max;
        if used == 2 && manifest.percentiles.iter().all(|pair| is_end(pair[1])) {
            let because = format!("every voxel is {} or {}", Number(all.min), Number(all.max));
            return Some((DataKind::Mask, because, Certainty::Certain));
        }
        // Newer containers say whether they hold labels. Bins narrower than 1 hold at most one whole number each.
        let labels = manifest.distribution.is_none()
            && self.integral
            && all.min >= 0.0
            && all.max <= LABEL_LIMIT
            && (2..=LABELS).contains(&used)
            && manifest.present_voxels >= VOXELS_PER_LABEL * used;
        let because = || format!("{used} different whole numbers from {} on", all.min);
        labels.then(|| (DataKind::Labels, because(), Certainty::Likely))
    }

    /// Number of different values: counted, or that of used bins in containers without a distribution.
    fn different_values(&self) -> u64 {
        match &self.manifest.distribution {
            Some(distribution) => distribution.distinct_values.unwrap_or(u64::MAX),
            None => self.histogram.bins_used() as u64,
        }
    }

    fn tomography(&self) -> Option<Found> {
        let Self { range, histogram, .. } = self;
        let says_ct = self.manifest.unit == "HU";
        let reaches = range.min <= -500.0 && range.min >= HOUNSFIELD[0] && (400.0..=HOUNSFIELD[1]).contains(&range.max);
        let air = histogram.share_between(AIR[0], AIR[1]);
        if says_ct || reaches && air >= 0.005 {
            let because =
                format!("values from {range}, {:.0} % of them near -1000 like air in Hounsfield units", 100.0 * air);
            let certainty = if says_ct { Certainty::Certain } else { Certainty::Likely };
            return Some((DataKind::Ct, because, certainty));
        }
        let soft = histogram.share_between(SOFT_WITH_OFFSET[0], SOFT_WITH_OFFSET[1]);
        let gap = histogram.share_between(GAP_WITH_OFFSET[0], GAP_WITH_OFFSET[1]);
        let with_offset = self.integral && range.min >= 0.0 && (1400.0..=8191.0).contains(&range.max);
        (with_offset && soft >= 0.08 && gap < soft / 2.0).then(|| {
            let because = format!(
                "whole numbers from {range}, {:.0} % of them near 1024 like soft tissue in Hounsfield units with 1024 added",
                100.0 * soft
            );
            (DataKind::CtOffset, because, Certainty::Likely)
        })
    }

    /// The device that made a DICOM file. Doses and images of other devices have no look of their own.
    fn modality(&self) -> Option<Found> {
        let modality = self.manifest.parameters.get(MODALITY)?;
        let kind = match modality.as_str() {
            "MR" => DataKind::Mri,
            "CT" => DataKind::Ct,
            _ => DataKind::Generic,
        };
        Some((kind, format!("the file says modality {modality}"), Certainty::Certain))
    }

    fn few_voxels(&self) -> Option<Found> {
        let few = self.manifest.present_voxels;
        let because = || format!("{few} voxels are too few to tell");
        (few < FEWEST_VOXELS).then(|| (DataKind::Generic, because(), Certainty::Guess))
    }

    fn patient(&self) -> Option<Found> {
        if WorldSpace::from_name(&self.manifest.space) == WorldSpace::Unknown {
            return None;
        }
        if self.name_says(&["ct", "cbct"]).is_some() && self.range.min >= 0.0 {
            let because = "its name says ct, though its values are no Hounsfield units".into();
            return Some((DataKind::Ct, because, Certainty::Likely));
        }
        let because = || "the image of a patient, by its space, and no computed tomography".into();
        (self.percentile(1.0) >= 0.0).then(|| (DataKind::Mri, because(), Certainty::Likely))
    }

    /// Magnetic resonance whose name says so.
    fn by_name(&self) -> Option<Found> {
        let word = self.name_says(&OF_RESONANCE)?;
        let because = || format!("its name says {word}, and no value is negative");
        (self.percentile(0.1) >= 0.0).then(|| (DataKind::Mri, because(), Certainty::Likely))
    }

    /// A stack of images: by the shape of the histogram, and the file's format.
    fn image(&self) -> Option<Found> {
        let Self { range, histogram, .. } = self;
        if self.percentile(0.1) < 0.0 || self.dims.0.iter().any(|n| *n < FEWEST_ALONG) {
            return None;
        }
        let at = |percent: f64| (self.percentile(percent) - range.min) / range.width();
        let format = self.manifest.source.format.as_str();
        let is_microscopy = self.is_of_a_microscope() || format == "tiff";
        if at(50.0) <= 0.1 && at(99.0) <= 0.35 && is_microscopy {
            let because = format!("99 % of the voxels are darker than {:.0} % of the greatest value", 100.0 * at(99.0));
            return Some((DataKind::Fluorescence, because, Certainty::Likely));
        }
        if !self.integral {
            return None;
        }
        // A quarter of equally frequent values lies on either side of the middle half: no tissue is like that.
        let is_bell = at(75.0) - at(25.0) <= 0.45;
        if histogram.fullest() <= 0.10 && (0.2..=0.8).contains(&at(50.0)) && is_bell && !histogram.has_background() {
            let because = "whole numbers, grey throughout, and no value for background".into();
            let is_stack = is_microscopy || format == "pictures";
            return Some((
                DataKind::ElectronMicroscopy,
                because,
                if is_stack { Certainty::Likely } else { Certainty::Guess },
            ));
        }
        let is_dark = at(50.0) <= 0.15 || histogram.fullest() >= 0.3;
        if is_dark && self.is_of_a_microscope() {
            let because = "the file of a microscope, with something bright in the dark".into();
            return Some((DataKind::Fluorescence, because, Certainty::Likely));
        }
        let because = || "whole numbers, a dark background and something denser, with a gap between both".into();
        histogram.has_background().then(|| (DataKind::MicroCt, because(), Certainty::Guess))
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

/// Parts of a word that begin at capital letters: `HeadMRVolume` is Head, MR, Volume.
fn capitalised(word: &str) -> impl Iterator<Item = &str> {
    let letters: Vec<(usize, char)> = word.char_indices().collect();
    let begins = |i: usize| {
        let is_upper = |i: usize| letters.get(i).is_some_and(|(_, c)| c.is_uppercase());
        let is_lower = |i: usize| letters.get(i).is_some_and(|(_, c)| c.is_lowercase());
        is_upper(i) && (is_lower(i - 1) || is_lower(i + 1) && is_upper(i - 1))
    };
    let starts = (1..letters.len()).filter(|&i| begins(i)).map(|i| letters[i].0);
    let ends: Vec<usize> = [0].into_iter().chain(starts).chain([word.len()]).collect();
    (1..ends.len()).map(move |i| &word[ends[i - 1]..ends[i]])
}

#[cfg(test)]
mod tests;
