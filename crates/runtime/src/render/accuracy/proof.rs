//! Proof of a picture file: its pixels are those of its container, within the errors that its record names.
//!
//! 1. The record names a container by a checksum; the given container must have it ([`Prover::new`]).
//! 2. The scene of the record is resolved. Its files are searched in given folders and must have their checksums.
//! 3. Sample pixels are cast again by the reference integrator, spread as in [`super::check`], and compared with the
//!    stored pixels. The record makes up to two *claims*:
//!    - the *requested* error, against the exact picture of the requested level (level 0 if levels were automatic). Only
//!      converged pictures without failures make it, by engines that aim at it, with a bound for each coarser brick;
//!    - the *stated* error, against the exact picture of level 0.
//! 4. The stored pixels must have the checksum of the record: a change of a pixel that was not cast is found as well.
//!
//! 8-bit pixels were rounded once: a channel v within a of the exact value is stored as a byte between
//! `round(255 (v - a))` and `round(255 (v + a))`. Floats have four channels and no background. Pixels under decorations
//! prove nothing and are not compared.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use supervol_format::cast::whole;
use supervol_format::container::ContainerError;
use supervol_format::readable::{Mib, counted};
use supervol_format::{Container, Lod};
use supervol_scene::facts::DataKind;
use supervol_scene::image::GREY_LEVELS;
use supervol_scene::image::stored::{StoredPicture, StoredPixels};
use supervol_scene::scene::{ResolvedScene, Scene, SceneError};

use super::check::{CheckProgress, Exact, SEED, cast_again, spread_pixels};
use super::reference::reference_bytes;
use crate::engines::rules::MAX_ERROR_LIMITS;
use crate::render::error::{ErrorKind, RenderError};
use crate::render::options::RenderOptions;
use crate::render::record::{PictureRecord, RecordError, file_digits};
use crate::render::volume::PlacedVolume;

/// Grey levels that `f32` pixels may be off by rounding alone: several roundings of a channel.
const FLOAT_ROUNDING: f64 = 1e-4;
/// Claims of this error and more are kept by every picture.
const EVERYTHING: f64 = GREY_LEVELS;
/// Most pixels that are listed where a claim does not hold.
const LISTED: usize = 5;
/// Pixels that are cast without another number.
pub const DEFAULT_PIXELS: u64 = 1000;

/// Sample of pixels, and means for casting them.
#[derive(Debug, Clone)]
pub struct ProofOptions {
    /// Number of pixels; all if the picture has fewer.
    pub pixels: u64,
    /// Seed of the choice of pixels.
    pub seed: u64,
    /// Bytes that the reference integrator may take.
    pub host_memory_bytes: u64,
    /// Threads that cast; `None`: one per processor.
    pub threads: Option<usize>,
    /// Folders that are searched for the files of the scene, in this order.
    pub folders: Vec<PathBuf>,
}

impl Default for ProofOptions {
    fn default() -> Self {
        let host_memory_bytes = RenderOptions::default().host_memory_bytes;
        Self { pixels: DEFAULT_PIXELS, seed: SEED, host_memory_bytes, threads: None, folders: Vec::new() }
    }
}

/// Reason why a picture can neither be proved nor refuted.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ProofError {
    #[error(
        "the picture has no record of what it shows. Pictures of Supervol carry one; programs that change a picture drop \
         it. Draw it again"
    )]
    NoRecord,
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("its record: expected a picture of {expected}, found {found}; another program changed it")]
    OtherPicture { expected: String, found: String },
    #[error(
        "it shows another container: its record names {name} with checksum {expected} ({covers}), found {found}. Give the \
         container that it was drawn from"
    )]
    OtherContainer { name: String, expected: String, found: String, covers: String },
    #[error("its record names no checksum of the container ({name}), because that could not be read")]
    NoChecksum { name: String },
    #[error("its scene needs the file {name}: expected checksum {expected}, found {found} in {folders}")]
    SceneFile { name: String, expected: String, found: String, folders: String },
    #[error("the scene of its record: {0}")]
    Scene(#[from] SceneError),
    #[error("it claims no error that could be proved: {why}{}. {advice}", match stated_grey_levels {
        Some(stated) => format!(", and it states {stated:.0} of 255 grey levels"),
        None => ", and it states no error".into(),
    })]
    NoClaim { why: String, stated_grey_levels: Option<f64>, advice: &'static str },
    #[error(
        "level {level} needs {} for the reference integrator, but the limit is {}; give more memory",
        Mib(*needed_bytes), Mib(*budget_bytes)
    )]
    TooLarge { level: u8, needed_bytes: u64, budget_bytes: u64 },
    #[error(transparent)]
    Container(#[from] ContainerError),
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl ProofError {
    /// The side at fault.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::TooLarge { .. } => ErrorKind::Request,
            Self::Render(error) => error.kind(),
            Self::Container(ContainerError::Io { .. }) => ErrorKind::Machine,
            _ => ErrorKind::Data,
        }
    }
}

/// Origin of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClaimKind {
    /// The requested error, which a converged picture keeps.
    Requested,
    /// The stated error.
    Stated,
}

/// An error that a picture claims to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Claim {
    /// Its origin.
    pub kind: ClaimKind,
    /// The level whose exact picture is meant.
    pub level: u8,
    /// Largest error of any channel, grey levels of 255.
    pub grey_levels: f64,
}

/// A pixel that breaks a claim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongPixel {
    /// Column and row, counted from the top left.
    pub pixel: [u32; 2],
    /// Channel: red, green, blue, opacity.
    pub channel: usize,
    /// Stored value, grey levels of 255.
    pub found: f64,
    /// Exact value before rounding, grey levels of 255.
    pub expected: f64,
    /// Difference that the claim and the rounding allow, grey levels of 255.
    pub allowed: f64,
}

/// Result of one claim.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimResult {
    /// The claim.
    pub claim: Claim,
    /// Largest difference from the exact picture, grey levels of 255; of 8-bit pixels with their rounding.
    pub largest_grey_levels: f64,
    /// Pixels that break the claim, of those cast.
    pub wrong_pixels: u64,
    /// The first of them in row order.
    pub wrong: Vec<WrongPixel>,
    /// Intervals at which the reference integrator did not converge.
    pub capped_pieces: u64,
}

/// Result of a proof.
#[derive(Debug, Clone, PartialEq)]
pub struct Proof {
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// Pixels cast again.
    pub pixels: u64,
    /// Pixels under decorations, which were not compared.
    pub pixels_decorated: u64,
    /// Whether the stored pixels have 8 bits a channel, so that differences include their rounding.
    pub are_pixels_rounded: bool,
    /// Whether the stored pixels have the checksum of the record.
    pub are_pixels_unchanged: bool,
    /// Whether the checksum covers the whole container.
    pub covers_content: bool,
    /// The claims with their results.
    pub claims: Vec<ClaimResult>,
    /// Claims that were not checked, with the reason.
    pub unchecked: Vec<(Claim, String)>,
}

impl Proof {
    /// Whether all claims hold and no pixel was changed.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.are_pixels_unchanged && self.claims.iter().all(|result| result.wrong_pixels == 0)
    }
}

/// Claims of a record; claims that every picture keeps are left out.
///
/// # Errors
/// [`ProofError::NoClaim`] if none is left.
pub fn claims_of(record: &PictureRecord) -> Result<Vec<Claim>, ProofError> {
    let without_bound = record.level.is_none() && record.bricks_without_bound > 0;
    let keeps_request = record.converged && record.bricks_failed == 0 && record.aims_at_error && !without_bound;
    let requested = keeps_request.then(|| Claim {
        kind: ClaimKind::Requested,
        level: record.level.unwrap_or(Lod::FINEST.0),
        grey_levels: record.requested_grey_levels.max(GREY_LEVELS * MAX_ERROR_LIMITS[0]),
    });
    let stated = record.stated.map(|stated| Claim {
        kind: ClaimKind::Stated,
        level: Lod::FINEST.0,
        grey_levels: stated.largest_grey_levels.max(0.0),
    });
    let claims: Vec<Claim> = [requested, stated].into_iter().flatten().collect();
    let strong: Vec<Claim> = claims.iter().copied().filter(|claim| claim.grey_levels < EVERYTHING).collect();
    if !strong.is_empty() {
        return Ok(strong);
    }
    let (why, advice) = if record.bricks_failed > 0 {
        (
            format!("{} could not be read", counted(record.bricks_failed, "brick")),
            "Mend the container, and draw it again",
        )
    } else if !record.converged {
        ("it has not converged".into(), "Draw it without a deadline")
    } else if without_bound {
        let bricks = counted(record.bricks_without_bound, "brick");
        (format!("{bricks} of coarser levels, with voxels smaller than pixels, have no bound"), "Draw it from level 0")
    } else if !record.aims_at_error {
        ("it is drawn by a method of comparison".into(), "Draw it by the default method")
    } else {
        (format!("{:.0} grey levels are requested", record.requested_grey_levels), "Ask for a smaller error")
    };
    let stated_grey_levels = record.stated.map(|stated| stated.largest_grey_levels);
    Err(ProofError::NoClaim { why, stated_grey_levels, advice })
}

/// A picture with its container and its scene, whose pixels can be cast again.
#[derive(Debug)]
pub struct Prover<'a> {
    stored: &'a StoredPicture,
    record: PictureRecord,
    volume: PlacedVolume,
    scene: ResolvedScene,
    options: &'a ProofOptions,
}

impl<'a> Prover<'a> {
    /// Reads the record of a picture, and checks that the container and the files of the scene are those that it names.
    ///
    /// # Errors
    /// If there is no record, or it is not of this picture or container, or a file of the scene is not found.
    pub fn new(
        container: &Container,
        stored: &'a StoredPicture,
        options: &'a ProofOptions,
    ) -> Result<Self, ProofError> {
        let record = PictureRecord::from_json(stored.record.as_deref().ok_or(ProofError::NoRecord)?)?;
        check_picture(&record, stored)?;
        check_container(&record, container)?;
        let container = Arc::new(container.at(record.container.geometry));
        let volume = match record.container.kind.parse::<DataKind>() {
            Ok(kind) => PlacedVolume::of_kind(container, kind),
            Err(_) => PlacedVolume::of(container),
        };
        let scene = with_files(&record, &options.folders)?.resolve(volume.facts())?;
        Ok(Self { stored, record, volume, scene, options })
    }

    /// The record of the picture.
    #[must_use]
    pub fn record(&self) -> &PictureRecord {
        &self.record
    }

    /// Casts pixels again and compares them. `progress` is called from any thread.
    ///
    /// # Errors
    /// If the picture claims no error, or no level fits the memory limit, or a brick cannot be read.
    pub fn prove(&self, progress: &(dyn Fn(CheckProgress) + Sync)) -> Result<Proof, ProofError> {
        let record = self.record.pixels.as_ref().expect("a checked record has pixels");
        let decorated = record.decorated();
        let width = self.stored.size[0] as usize;
        let lies_free = |&[x, y]: &[u32; 2]| !decorated[y as usize * width + x as usize];
        let mut pixels = spread_pixels(self.stored.size, self.options.pixels, self.options.seed);
        pixels.retain(lies_free);
        pixels.sort_unstable_by_key(|&[x, y]| (y, x));
        let (mut claims, mut unchecked) = (Vec::new(), Vec::new());
        let mut made = claims_of(&self.record)?;
        while let Some(&Claim { level, .. }) = made.first() {
            // Claims about one level share its exact pixels.
            let (of_level, others): (Vec<Claim>, Vec<Claim>) = made.into_iter().partition(|claim| claim.level == level);
            match self.exact(level, &pixels, progress) {
                Ok(exact) => claims.extend(of_level.into_iter().map(|claim| self.result(claim, &pixels, &exact))),
                Err(error @ ProofError::TooLarge { .. }) if !others.is_empty() || !claims.is_empty() => {
                    unchecked.extend(of_level.into_iter().map(|claim| (claim, error.to_string())));
                }
                Err(error) => return Err(error),
            }
            made = others;
        }
        Ok(Proof {
            size: self.stored.size,
            pixels: pixels.len() as u64,
            pixels_decorated: decorated.iter().filter(|&&is| is).count() as u64,
            are_pixels_rounded: matches!(self.stored.pixels, StoredPixels::Rgb8(_)),
            are_pixels_unchanged: crate::render::record::digits(self.stored.checksum()) == record.xxh3_64,
            covers_content: self.record.container.covers == "content",
            claims,
            unchecked,
        })
    }

    /// Exact pixels of a level.
    fn exact(
        &self,
        level: u8,
        pixels: &[[u32; 2]],
        progress: &(dyn Fn(CheckProgress) + Sync),
    ) -> Result<Exact, ProofError> {
        let (container, budget_bytes) = (self.volume.container(), self.options.host_memory_bytes);
        let lod = Lod(level).min(container.pyramid().coarsest());
        let needed_bytes = reference_bytes(container, lod, &self.scene);
        if needed_bytes > budget_bytes {
            return Err(ProofError::TooLarge { level: lod.0, needed_bytes, budget_bytes });
        }
        let ProofOptions { host_memory_bytes, threads, .. } = *self.options;
        let options = RenderOptions { host_memory_bytes, threads, ..RenderOptions::default() };
        Ok(cast_again(container, lod, &self.scene, &options, pixels, progress)?)
    }

    /// Compares the stored pixels with the exact ones.
    fn result(&self, claim: Claim, pixels: &[[u32; 2]], exact: &Exact) -> ClaimResult {
        let mut result = ClaimResult {
            claim,
            largest_grey_levels: 0.0,
            wrong_pixels: 0,
            wrong: Vec::new(),
            capped_pieces: exact.capped_pieces,
        };
        for (&pixel, exact) in pixels.iter().zip(&exact.pixels) {
            let compared = self.compare(pixel, exact, claim.grey_levels);
            let worst = compared.iter().fold(0.0, |worst, c| f64::max(worst, (c.found - c.expected).abs()));
            result.largest_grey_levels = result.largest_grey_levels.max(worst);
            if let Some(wrong) = compared.into_iter().find(|c| c.is_wrong) {
                result.wrong_pixels += 1;
                if result.wrong.len() < LISTED {
                    let Compared { channel, found, expected, allowed, .. } = wrong;
                    result.wrong.push(WrongPixel { pixel, channel, found, expected, allowed });
                }
            }
        }
        result
    }

    /// Compares the channels of a stored pixel with the exact ones. All numbers are grey levels.
    fn compare(&self, [x, y]: [u32; 2], exact: &[f32; 4], claimed: f64) -> Vec<Compared> {
        let at = y as usize * self.stored.size[0] as usize + x as usize;
        match &self.stored.pixels {
            StoredPixels::Rgb8(pixels) => (0..3)
                .map(|channel| {
                    let behind = (1.0 - f64::from(exact[3])) * self.scene.background[channel];
                    let expected = GREY_LEVELS * (f64::from(exact[channel]) + behind);
                    let byte = |v: f64| whole::<u8>(v.clamp(0.0, GREY_LEVELS).round());
                    let claimed = claimed + FLOAT_ROUNDING;
                    let stored = pixels[at][channel];
                    let is_wrong = !(byte(expected - claimed)..=byte(expected + claimed)).contains(&stored);
                    let (found, expected) = (f64::from(stored), expected.clamp(0.0, GREY_LEVELS));
                    Compared { channel, found, expected, allowed: claimed + 0.5, is_wrong }
                })
                .collect(),
            StoredPixels::Floats(pixels) => (0..4)
                .map(|channel| {
                    let [found, expected] = [pixels[at], *exact].map(|p| GREY_LEVELS * f64::from(p[channel]));
                    let allowed = claimed + FLOAT_ROUNDING;
                    // NaN is wrong.
                    let is_right = (found - expected).abs() <= allowed;
                    Compared { channel, found, expected, allowed, is_wrong: !is_right }
                })
                .collect(),
        }
    }
}

/// Comparison of one channel.
struct Compared {
    channel: usize,
    found: f64,
    expected: f64,
    allowed: f64,
    is_wrong: bool,
}

/// Checks that a record is of this picture.
fn check_picture(record: &PictureRecord, stored: &StoredPicture) -> Result<(), ProofError> {
    let pixels = record.pixels.as_ref().expect("a checked record has pixels");
    let words = |[width, height]: [u32; 2], format: &str| format!("{width} x {height} pixels, {format}");
    if pixels.size == stored.size && pixels.format == stored.format.ending() {
        return Ok(());
    }
    let expected = words(pixels.size, &pixels.format);
    Err(ProofError::OtherPicture { expected, found: words(stored.size, stored.format.ending()) })
}

/// Checks that a container is the one that a record names.
fn check_container(record: &PictureRecord, container: &Container) -> Result<(), ProofError> {
    let named = &record.container;
    let Some(expected) = &named.xxh3_64 else { return Err(ProofError::NoChecksum { name: named.name.clone() }) };
    let identity = container.identity()?;
    if *expected == identity.digits() && named.covers == identity.covers.name() {
        return Ok(());
    }
    Err(ProofError::OtherContainer {
        name: named.name.clone(),
        expected: expected.clone(),
        found: identity.digits(),
        covers: format!("of its {}", named.covers),
    })
}

/// The scene of a record, whose files are those in `folders` with the recorded checksums.
fn with_files(record: &PictureRecord, folders: &[PathBuf]) -> Result<Scene, ProofError> {
    let mut scene = record.scene.clone();
    for mesh in scene.clip.solids.iter_mut().filter_map(|solid| solid.mesh.as_mut()) {
        let name = mesh.to_string_lossy().into_owned();
        let expected = record.files.iter().find(|file| file.name == name).and_then(|file| file.xxh3_64.clone());
        let candidates = folders.iter().map(|folder| folder.join(&name));
        let found: Vec<(PathBuf, String)> =
            candidates.filter_map(|path| file_digits(&path).ok().map(|sum| (path, sum))).collect();
        match found.iter().find(|(_, sum)| Some(sum) == expected.as_ref()) {
            Some((path, _)) => mesh.clone_from(path),
            None => {
                let sums: Vec<&str> = found.iter().map(|(_, sum)| &**sum).collect();
                let found = if sums.is_empty() { "no such file".into() } else { sums.join(", ") };
                let expected = expected.unwrap_or_else(|| "none, because it could not be read".into());
                return Err(ProofError::SceneFile { name, expected, found, folders: listed(folders) });
            }
        }
    }
    Ok(scene)
}

fn listed(folders: &[PathBuf]) -> String {
    let shown = |folder: &Path| if folder.as_os_str().is_empty() { ".".into() } else { folder.display().to_string() };
    folders.iter().map(|folder| shown(folder)).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::accuracy::stated::ErrorStated;
    use crate::render::record::tests::record;

    fn stated(largest_grey_levels: f64) -> Option<ErrorStated> {
        Some(ErrorStated {
            largest_grey_levels,
            mean_grey_levels: 0.0,
            levels_grey_levels: 0.0,
            presence_may_change: false,
            pixels_unknown: 0,
        })
    }

    #[test]
    fn converged_pictures_claim_what_was_requested_and_all_claim_what_they_state() {
        let requested = |level| Claim { kind: ClaimKind::Requested, level, grey_levels: 0.5 };
        let of_stated = Claim { kind: ClaimKind::Stated, level: 0, grey_levels: 3.0 };
        assert_eq!(claims_of(&record()).unwrap(), [requested(0)]);
        let both = PictureRecord { stated: stated(3.0), level: Some(2), bricks_without_bound: 5, ..record() };
        assert_eq!(claims_of(&both).unwrap(), [requested(2), of_stated]);
        let late = PictureRecord { stated: stated(3.0), converged: false, ..record() };
        assert_eq!(claims_of(&late).unwrap(), [of_stated]);
        // Less than engines aim at is not claimed.
        let least = claims_of(&PictureRecord { requested_grey_levels: 0.0, ..record() }).unwrap()[0].grey_levels;
        assert!((least - 0.05).abs() < 1e-12, "{least}");
    }

    #[test]
    fn pictures_without_a_claim_say_why_and_what_to_do() {
        let told = |record: PictureRecord| claims_of(&record).unwrap_err().to_string();
        assert!(told(PictureRecord { converged: false, ..record() }).contains("without a deadline"));
        let coarse = told(PictureRecord { bricks_without_bound: 3, stated: stated(255.0), ..record() });
        assert!(
            coarse.contains("3 bricks") && coarse.contains("states 255") && coarse.contains("from level 0"),
            "{coarse}"
        );
        assert!(told(PictureRecord { requested_grey_levels: 255.0, ..record() }).contains("smaller error"));
        assert!(told(PictureRecord { aims_at_error: false, ..record() }).contains("states no error"));
        assert!(told(PictureRecord { converged: false, bricks_failed: 1, ..record() }).contains("1 brick could"));
    }
}
