//! Fidelity of a picture: whether it is reduced, in which dimension, why, for how long, and by how many grey levels.
//!
//! Dimensions, causes and states are those of the viewport fidelity draft of OHIF and Cornerstone3D (OHIF/Viewers pull
//! request 6254, cornerstonejs/cornerstone3D issue 2902, September 2026). Its set of causes is open; this program adds
//! [`Cause::Requested`] and [`Cause::OutputFormat`]. It also states the error of each dimension in grey levels (1/255 of
//! full scale), which the draft does not.
//!
//! The faithful picture is that of the source's own voxels. Errors within half a grey level by integration and fits are
//! no reduction: no 8-bit screen shows them.

use serde::Serialize;
use supervol_format::readable::{Number, counted};
use supervol_format::{Container, Lod};
use supervol_scene::image::{GREY_LEVELS, ImageFormat};
use supervol_scene::scene::Mode;

use crate::engines::rules::DEFAULT_ERROR;
use crate::render::options::LevelChoice;
use crate::render::record::{Drawn, DrawnBy};
use crate::render::stats::{FrameStats, mode_name};

/// Version of the JSON form.
const FIDELITY_VERSION: u32 = 1;
/// Origin of the words.
const VOCABULARY: &str = "viewport fidelity, draft of OHIF/Viewers#6254 and cornerstonejs/cornerstone3D#2902 (2026-09)";
/// Error by which rounding to 8 bits moves a channel, grey levels: a bound.
const ROUNDED_TO_8_BITS: f64 = 0.5;
/// Reason why an error is unknown that nobody asked for.
const NOT_STATED: &str = "the error was not stated, because it was not requested (predict_error)";

/// Dimension along which a picture may be reduced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Dimension {
    /// Voxels: coarser levels than the source's.
    DataResolution,
    /// Pixels: larger ones than requested.
    DisplayResolution,
    /// Samples along rays.
    SamplingDensity,
    /// Parts of the data that were read and decoded.
    DecodedExtent,
    /// Steps of voxel values and of pixel values.
    PixelValueQuantisation,
    /// Fit of the transfer function.
    TransformApproximation,
    /// Method that draws.
    RenderingPath,
}

impl Dimension {
    /// All dimensions, in the order of reports.
    pub const ALL: [Self; 7] = [
        Self::DataResolution,
        Self::DisplayResolution,
        Self::SamplingDensity,
        Self::DecodedExtent,
        Self::PixelValueQuantisation,
        Self::TransformApproximation,
        Self::RenderingPath,
    ];

    /// Meaning, for readers who know no renderer.
    #[must_use]
    pub fn in_words(self) -> &'static str {
        match self {
            Self::DataResolution => "detail of the data",
            Self::DisplayResolution => "sharpness of the picture",
            Self::SamplingDensity => "accuracy along the line of sight",
            Self::DecodedExtent => "parts of the data that were read",
            Self::PixelValueQuantisation => "steps of the values",
            Self::TransformApproximation => "accuracy of colours and opacities",
            Self::RenderingPath => "method of drawing",
        }
    }
}

/// Reason of a reduction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The device cannot do more.
    DeviceCapabilityLimit,
    /// More would take longer than a target allows, and the requested error does not need it.
    PerformanceTarget,
    /// Data is missing: not read yet, or not readable.
    IncompleteLoad,
    /// The container holds voxels that differ from the source's.
    IrreversiblyLossyDecode,
    /// The caller asked for the reduction: a level, a greater error, a method of comparison.
    Requested,
    /// The format of the picture file.
    OutputFormat,
}

/// State of a picture or dimension over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Lossiness {
    /// Reduced for now: waiting helps.
    TransientlyLossy,
    /// Reduced for good.
    TerminallyLossy,
    /// Was once reduced, and is no longer.
    FormerlyLossy,
    /// Never was reduced.
    NeverLossy,
}

/// Whether drawing goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlook {
    /// The picture stays as it is, for example in a file.
    Final,
    /// A renderer goes on with the picture.
    GoesOn,
}

/// Circumstances of a picture beside its drawing.
#[derive(Debug, Clone, Copy)]
pub struct Circumstances<'a> {
    /// Format of its file; `None`: floats in memory.
    pub format: Option<ImageFormat>,
    /// Whether drawing goes on.
    pub outlook: Outlook,
    /// Dimensions that were reduced for a time in earlier pictures of the same data.
    pub once: &'a [Dimension],
}

/// A reduction along a dimension.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reduction {
    /// The reason.
    pub cause: Cause,
    /// Its size, in words with numbers.
    pub magnitude: String,
    /// Whether waiting removes it.
    pub waiting_helps: bool,
}

/// Fidelity along one dimension.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DimensionFidelity {
    /// The dimension.
    pub dimension: Dimension,
    /// Whether the picture is reduced along it.
    pub is_reduced: bool,
    /// State over time.
    pub lossiness: Lossiness,
    /// All reductions.
    pub reductions: Vec<Reduction>,
    /// Largest error of any channel of any pixel for this reason, grey levels of 255; null if unknown.
    pub grey_levels: Option<f64>,
    /// Whether that is a bound; otherwise it is an estimate.
    pub is_bound: bool,
    /// Reason why the error is unknown.
    pub unknown_because: Option<String>,
}

/// Fidelity of a picture; see the module. The JSON form is documented in `docs/fidelity.md`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fidelity {
    /// Version of this form.
    pub fidelity_version: u32,
    /// Origin of the words.
    pub vocabulary: &'static str,
    /// Requested error, grey levels of 255.
    pub requested_grey_levels: f64,
    /// Largest stated error of a pixel, grey levels of 255; null if it was not asked for.
    pub stated_grey_levels: Option<f64>,
    /// Mean stated error of a pixel.
    pub mean_stated_grey_levels: Option<f64>,
    /// Whether the picture is reduced along any dimension.
    pub is_reduced: bool,
    /// State of the whole picture.
    pub lossiness: Lossiness,
    /// Whether waiting improves the picture.
    pub waiting_helps: bool,
    /// The same in plain words.
    pub in_words: String,
    /// The dimensions in the order of [`Dimension::ALL`].
    pub dimensions: Vec<DimensionFidelity>,
}

/// Error of one dimension.
enum Error {
    Bound(f64),
    Estimate(f64),
    Unknown(String),
}

impl Fidelity {
    /// Fidelity of a picture.
    #[must_use]
    pub fn of(drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> Self {
        let dimensions: Vec<DimensionFidelity> =
            Dimension::ALL.into_iter().map(|dimension| along(dimension, drawn, circumstances)).collect();
        let any = |state| dimensions.iter().any(|d| d.lossiness == state);
        let states = [Lossiness::TerminallyLossy, Lossiness::TransientlyLossy, Lossiness::FormerlyLossy];
        let stated = drawn.stats.error_stated.as_ref();
        let mut fidelity = Self {
            fidelity_version: FIDELITY_VERSION,
            vocabulary: VOCABULARY,
            requested_grey_levels: GREY_LEVELS * drawn.options.max_error,
            stated_grey_levels: stated.map(|stated| stated.largest_grey_levels),
            mean_stated_grey_levels: stated.map(|stated| stated.mean_grey_levels),
            is_reduced: dimensions.iter().any(|d| d.is_reduced),
            lossiness: states.into_iter().find(|&state| any(state)).unwrap_or(Lossiness::NeverLossy),
            waiting_helps: dimensions.iter().any(|d| d.reductions.iter().any(|r| r.waiting_helps)),
            in_words: String::new(),
            dimensions,
        };
        fidelity.in_words = fidelity.words();
        fidelity
    }

    /// The dimension with this name.
    ///
    /// # Panics
    /// Never: all dimensions are there.
    #[must_use]
    pub fn along(&self, dimension: Dimension) -> &DimensionFidelity {
        self.dimensions.iter().find(|d| d.dimension == dimension).expect("all dimensions are there")
    }

    /// Dimensions that waiting improves.
    pub fn improving(&self) -> impl Iterator<Item = Dimension> {
        let improves = |d: &&DimensionFidelity| d.reductions.iter().any(|r| r.waiting_helps);
        self.dimensions.iter().filter(improves).map(|d| d.dimension)
    }

    fn words(&self) -> String {
        let mut words = asked_and_stated(self.requested_grey_levels, self.stated_grey_levels);
        let reduced: Vec<String> = self
            .dimensions
            .iter()
            .flat_map(|d| d.reductions.iter().map(|r| (d.dimension, r)))
            .map(|(dimension, r)| {
                let time = if r.waiting_helps { "for now" } else { "for good" };
                format!("{} ({time}): {}", dimension.in_words(), r.magnitude)
            })
            .collect();
        words.push_str(&match (reduced.is_empty(), self.lossiness) {
            (true, Lossiness::FormerlyLossy) => " Nothing is reduced any more.".into(),
            (true, _) => " Nothing is reduced.".into(),
            (false, _) => format!(" Reduced: {}.", reduced.join("; ")),
        });
        words
    }
}

/// Requested and stated error in plain words.
#[must_use]
pub fn asked_and_stated(requested_grey_levels: f64, stated_grey_levels: Option<f64>) -> String {
    let asked = grey_levels(requested_grey_levels);
    match stated_grey_levels {
        Some(stated) => {
            format!(
                "Asked: within {asked} of 255 grey levels. Stated: within {} at the worst pixel.",
                grey_levels(stated)
            )
        }
        None => format!("Asked: within {asked} of 255 grey levels. Stated: nothing yet."),
    }
}

/// A number of grey levels with two decimals at most, rounded up.
#[must_use]
pub fn grey_levels(grey_levels: f64) -> String {
    Number((grey_levels * 100.0 - 1e-6).ceil().max(0.0) / 100.0).to_string()
}

/// Missing parts of a picture in words that need no knowledge of renderers; `None` if nothing is missing.
#[must_use]
pub fn missing_in_words(stats: &FrameStats, outlook: Outlook) -> Option<String> {
    let time = match outlook {
        Outlook::GoesOn => "waiting sharpens it",
        Outlook::Final => "it stays so",
    };
    let mut missing = Vec::new();
    if stats.pixels_unfinished > 0 {
        let pixels = u64::from(stats.image_width) * u64::from(stats.image_height);
        let share = (100.0 * stats.pixels_unfinished as f64 / pixels.max(1) as f64).clamp(1.0, 100.0);
        missing.push(format!("full sharpness on {share:.0} % of the picture ({time})"));
    } else if stats.bricks_missing_at_deadline > 0 {
        missing.push(format!("{} of data ({time})", counted(stats.bricks_missing_at_deadline, "part")));
    }
    if stats.bricks_failed > 0 {
        missing.push(format!("{} of data, unreadable for good", counted(stats.bricks_failed, "part")));
    }
    (!missing.is_empty()).then(|| missing.join(", "))
}

fn along(dimension: Dimension, drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> DimensionFidelity {
    let (reductions, error) = match dimension {
        Dimension::DataResolution => data_resolution(drawn, circumstances),
        Dimension::DisplayResolution => display_resolution(drawn, circumstances),
        Dimension::SamplingDensity => integration(drawn, |predicted| [predicted.cells, predicted.ray_ends]),
        Dimension::DecodedExtent => decoded_extent(drawn, circumstances),
        Dimension::PixelValueQuantisation => quantisation(drawn, circumstances),
        Dimension::TransformApproximation => transform(drawn),
        Dimension::RenderingPath => rendering_path(drawn),
    };
    let helps = |help: bool| reductions.iter().any(|reduction: &Reduction| reduction.waiting_helps == help);
    let lossiness = if helps(false) {
        Lossiness::TerminallyLossy
    } else if helps(true) {
        Lossiness::TransientlyLossy
    } else if circumstances.once.contains(&dimension) {
        Lossiness::FormerlyLossy
    } else {
        Lossiness::NeverLossy
    };
    let (grey_levels, is_bound, unknown_because) = match error {
        Error::Bound(grey_levels) => (Some(grey_levels), true, None),
        Error::Estimate(grey_levels) => (Some(grey_levels), false, None),
        Error::Unknown(why) => (None, false, Some(why)),
    };
    DimensionFidelity {
        dimension,
        is_reduced: !reductions.is_empty(),
        lossiness,
        reductions,
        grey_levels,
        is_bound,
        unknown_because,
    }
}

fn for_now(circumstances: &Circumstances<'_>) -> bool {
    circumstances.outlook == Outlook::GoesOn
}

fn for_good(cause: Cause, magnitude: impl Into<String>) -> Reduction {
    Reduction { cause, magnitude: magnitude.into(), waiting_helps: false }
}

/// Coarseness of a level against the source's voxels, as clinical viewers write it.
fn decimation(container: &Container, level: u8) -> String {
    let [x, y, z] = container.pyramid().level_at(Lod(level).min(container.pyramid().coarsest())).scale;
    format!("decimated volume x/{x}, y/{y}, z/{z}")
}

/// The error by coarser and moved voxels, or the reason why it is unknown.
fn error_by_voxels(stats: &FrameStats) -> Error {
    match &stats.error_stated {
        None => Error::Unknown(NOT_STATED.into()),
        Some(stated) if stated.pixels_unknown > 0 => {
            Error::Unknown(format!("{} are not finished", counted(stated.pixels_unknown, "pixel")))
        }
        Some(stated) => Error::Bound(stated.levels_grey_levels),
    }
}

fn data_resolution(drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> (Vec<Reduction>, Error) {
    let stats = drawn.stats;
    let coarsest = match drawn.options.level {
        LevelChoice::Fixed(lod) => lod.min(drawn.container.pyramid().coarsest()).0,
        LevelChoice::Auto => stats.levels_drawn.last().copied().unwrap_or(0),
    };
    if coarsest == 0 && stats.fallbacks == 0 {
        return (Vec::new(), Error::Bound(0.0));
    }
    let error = error_by_voxels(stats);
    let drawn_as = |level| decimation(drawn.container, level);
    let reduction = if let LevelChoice::Fixed(lod) = drawn.options.level
        && lod > Lod::FINEST
    {
        for_good(Cause::Requested, drawn_as(coarsest))
    } else if stats.fallbacks > 0 {
        let waiting_helps = for_now(circumstances) && stats.bricks_failed == 0;
        Reduction { cause: Cause::IncompleteLoad, magnitude: format!("up to {}", drawn_as(coarsest)), waiting_helps }
    } else if matches!(error, Error::Bound(grey_levels) if grey_levels == 0.0) {
        // Bricks of coarser levels that hold the same values.
        return (Vec::new(), error);
    } else {
        let place = match stats.bricks_without_bound {
            0 => "where the requested error allows it",
            _ => "where voxels are smaller than pixels, or the requested error allows it",
        };
        for_good(Cause::PerformanceTarget, format!("up to {}, {place}", drawn_as(coarsest)))
    };
    (vec![reduction], error)
}

fn display_resolution(drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> (Vec<Reduction>, Error) {
    let stats = drawn.stats;
    if stats.pixels_unfinished == 0 {
        return (Vec::new(), Error::Bound(0.0));
    }
    let pixels = u64::from(stats.image_width) * u64::from(stats.image_height);
    let edge = stats.coarsest_pixel.max(1);
    let share = 100.0 * stats.pixels_unfinished as f64 / pixels.max(1) as f64;
    let magnitude = format!("output resolution {:.1} % on {share:.1} % of the pixels", 100.0 / f64::from(edge));
    let waiting_helps = for_now(circumstances);
    let cause = if waiting_helps { Cause::IncompleteLoad } else { Cause::PerformanceTarget };
    let error = stats.error_stated.as_ref().map_or_else(
        || Error::Unknown(NOT_STATED.into()),
        // Channels lie in [0, 1]: that bounds the error of unfinished pixels.
        |stated| Error::Bound(stated.largest_grey_levels.min(GREY_LEVELS)),
    );
    (vec![Reduction { cause, magnitude, waiting_helps }], error)
}

/// Reduction and error by integration; `terms` chooses the terms of the predicted error.
fn integration(
    drawn: &Drawn<'_>,
    terms: impl Fn(&crate::render::accuracy::predict::ErrorPredicted) -> [crate::render::accuracy::predict::Term; 2],
) -> (Vec<Reduction>, Error) {
    let stats = drawn.stats;
    let is_dvr = stats.mode == mode_name(Mode::Dvr);
    let is_coarse = drawn.options.max_error > DEFAULT_ERROR && is_dvr && stats.backend != "reference";
    let magnitude = || {
        let [asked, default] = [drawn.options.max_error, DEFAULT_ERROR].map(|e| grey_levels(GREY_LEVELS * e));
        format!("{asked} grey levels are allowed instead of {default}")
    };
    let reductions = is_coarse.then(|| for_good(Cause::Requested, magnitude())).into_iter().collect();
    let error = match &stats.error_predicted {
        Some(predicted) => {
            let terms = terms(predicted);
            match terms.iter().map(|term| term.grey_levels).sum::<Option<f64>>() {
                Some(sum) if terms.iter().all(|term| term.is_bound) => Error::Bound(sum),
                Some(sum) => Error::Estimate(sum),
                None => Error::Unknown("the engine does not state it".into()),
            }
        }
        None if stats.backend == "reference" => Error::Estimate(0.0),
        None if stats.pixels_unfinished > 0 => {
            Error::Unknown(format!("{} are not finished", counted(stats.pixels_unfinished, "pixel")))
        }
        None if stats.error_stated.is_some() => {
            Error::Unknown(format!("in mode {} it is part of the stated error, not a term of its own", stats.mode))
        }
        None => Error::Unknown(NOT_STATED.into()),
    };
    (reductions, error)
}

fn transform(drawn: &Drawn<'_>) -> (Vec<Reduction>, Error) {
    let none = crate::render::accuracy::predict::Term { grey_levels: Some(0.0), is_bound: true };
    integration(drawn, |predicted| [predicted.transfer_function, none])
}

fn decoded_extent(drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> (Vec<Reduction>, Error) {
    let stats = drawn.stats;
    let mut reductions = Vec::new();
    if stats.bricks_failed > 0 {
        let magnitude =
            format!("{} of {} unreadable, drawn coarser", stats.bricks_failed, counted(stats.bricks_total, "brick"));
        reductions.push(for_good(Cause::IncompleteLoad, magnitude));
    }
    if stats.bricks_missing_at_deadline > 0 {
        let magnitude = format!("{} not read yet, drawn coarser", counted(stats.bricks_missing_at_deadline, "brick"));
        let waiting_helps = for_now(circumstances);
        reductions.push(Reduction { cause: Cause::IncompleteLoad, magnitude, waiting_helps });
    }
    let error = if reductions.is_empty() { Error::Bound(0.0) } else { error_by_voxels(stats) };
    (reductions, error)
}

fn quantisation(drawn: &Drawn<'_>, circumstances: &Circumstances<'_>) -> (Vec<Reduction>, Error) {
    let (mut reductions, mut error) = (Vec::new(), Error::Bound(0.0));
    let descriptor = drawn.container.descriptor();
    let moved = descriptor.voxel_error() * descriptor.scale.abs();
    if moved > 0.0 {
        let unit = &drawn.container.manifest().unit;
        let magnitude = format!("voxels differ from the source's by at most {} {unit}", Number(moved));
        reductions.push(for_good(Cause::IrreversiblyLossyDecode, magnitude.trim_end()));
        error = match error_by_voxels(drawn.stats) {
            Error::Bound(_) if drawn.stats.levels_drawn.iter().any(|&level| level > 0) => {
                Error::Unknown("it is part of the error of data_resolution, which bounds both".into())
            }
            other => other,
        };
    }
    if circumstances.format == Some(ImageFormat::Png) {
        reductions.push(for_good(Cause::OutputFormat, "8 bits a channel: values are rounded to whole grey levels"));
        error = match error {
            Error::Bound(grey_levels) => Error::Bound(grey_levels + ROUNDED_TO_8_BITS),
            other => other,
        };
    }
    (reductions, error)
}

fn rendering_path(drawn: &Drawn<'_>) -> (Vec<Reduction>, Error) {
    match drawn.engine {
        DrawnBy::Supervol if drawn.options.caster.is_default() => (Vec::new(), Error::Bound(0.0)),
        DrawnBy::Supervol => {
            let reduction = for_good(Cause::Requested, "a method of comparison draws");
            (vec![reduction], Error::Unknown("methods of comparison do not state it".into()))
        }
        DrawnBy::Caller => {
            let reduction = for_good(Cause::Requested, "an engine of the calling program draws");
            (vec![reduction], Error::Unknown("only its program knows".into()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_parts_are_told_without_words_of_renderers() {
        let whole = FrameStats { image_width: 100, image_height: 10, ..FrameStats::default() };
        assert_eq!(missing_in_words(&whole, Outlook::GoesOn), None);
        let half = FrameStats { pixels_unfinished: 500, bricks_missing_at_deadline: 3, ..whole.clone() };
        let words = missing_in_words(&half, Outlook::GoesOn).unwrap();
        assert_eq!(words, "full sharpness on 50 % of the picture (waiting sharpens it)");
        assert!(missing_in_words(&half, Outlook::Final).unwrap().contains("it stays so"));
        let failed = FrameStats { bricks_failed: 2, ..whole };
        assert_eq!(missing_in_words(&failed, Outlook::GoesOn).unwrap(), "2 parts of data, unreadable for good");
    }

    #[test]
    fn grey_levels_are_rounded_up() {
        assert_eq!([0.5, 4.8812, 255.0, 0.0, 0.001].map(grey_levels), ["0.5", "4.89", "255", "0", "0.01"]);
        assert!(asked_and_stated(0.5, None).contains("nothing yet"));
    }
}
