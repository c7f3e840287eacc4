//! `supervol verify PICTURE --container FILE`: proves a picture with the record that it carries.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use supervol::{
    CheckProgress, Claim, ClaimKind, ClaimResult, Error, ErrorKind, Proof, ProofError, ProofOptions, Volume, WrongPixel,
};
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::progress::Reporter;
use supervol_arguments::quantity::show_bytes;
use supervol_format::readable::counted;
use supervol_scene::image::read::StoredError;

use crate::picture::with_picture;

/// Time before a proof or a check shows its progress.
const QUIET: Duration = Duration::from_secs(1);
/// Names of the channels.
const CHANNELS: [&str; 4] = ["red", "green", "blue", "opacity"];

/// Number of pixels to cast again: a number from 1 on, or `all`.
pub fn pixels(text: &str) -> Result<u64, String> {
    if text == "all" {
        return Ok(u64::MAX);
    }
    text.parse().ok().filter(|&n| n > 0).ok_or_else(|| format!("'{text}': expected a number from 1 on, or all"))
}

/// Proves a picture. `files` is a folder with the files of its scene; without it, the folders of picture and container
/// are searched.
pub fn prove(path: &Path, volume: &Volume, options: &ProofOptions, files: Option<&Path>) -> Result<(), Failure> {
    let folder_of = |file: &Path| file.parent().map(PathBuf::from).unwrap_or_default();
    let folders = match files {
        Some(folder) => vec![folder.into()],
        None => vec![folder_of(path), folder_of(volume.container().path())],
    };
    let options = ProofOptions { folders, ..options.clone() };
    let proof = with_ray_bar(|progress| volume.prove_telling(path, &options, progress));
    report(path, &proof.map_err(with_error)?)
}

/// Casts rays with the reference integrator, with a progress bar if that takes longer than [`QUIET`].
pub fn with_ray_bar<T>(cast: impl FnOnce(&(dyn Fn(CheckProgress) + Sync)) -> T) -> T {
    let (bar, start) = (Reporter::over_rays(), Instant::now());
    let result = cast(&|CheckProgress { pixels_done, pixels }| {
        if start.elapsed() > QUIET {
            bar.set_length(pixels);
            bar.set_position(pixels_done);
        }
    });
    bar.finish_and_clear();
    result
}

/// Prints the result of a proof; fails if a claim does not hold.
fn report(path: &Path, proof: &Proof) -> Result<(), Failure> {
    let mut out = supervol_arguments::terminal::remarks();
    let shown = path.display();
    for result in proof.claims.iter().filter(|result| result.wrong_pixels == 0) {
        let line = format!("{shown}: {}", held(proof, result));
        writeln!(out, "{line}").map_err(with_output)?;
    }
    for (claim, why) in &proof.unchecked {
        writeln!(out, "{shown}: not checked: {}: {why} (option --memory)", claimed(claim)).map_err(with_output)?;
    }
    if proof.pixels_decorated > 0 {
        let all = u64::from(proof.size[0]) * u64::from(proof.size[1]);
        let share = 100.0 * proof.pixels_decorated as f64 / all as f64;
        let line = format!("{share:.1} % of the pixels lie under decorations and were not compared");
        writeln!(out, "{shown}: {line}").map_err(with_output)?;
    }
    if !proof.covers_content {
        let line = "the checksum covers the description of the container, not its bricks: there are too many";
        writeln!(out, "{shown}: {line}").map_err(with_output)?;
    }
    if let Some(broken) = proof.claims.iter().find(|result| result.wrong_pixels > 0) {
        return Err(Failure::Data(format!("{shown}: {}", refuted(proof, broken))));
    }
    if proof.are_pixels_unchanged {
        return Ok(());
    }
    Err(Failure::Data(format!(
        "{shown}: not proved: its pixels are not those that were written, as their checksum shows; none of the {} cast \
         again is beyond its error. Use --rays all to find those that are",
        counted(proof.pixels, "pixel")
    )))
}

fn claimed(claim: &Claim) -> String {
    let (kind, level) = (kind_of(claim.kind), claim.level);
    format!("the {kind} error of {} of 255 grey levels against level {level}", rounded(claim.grey_levels))
}

fn kind_of(kind: ClaimKind) -> &'static str {
    match kind {
        ClaimKind::Requested => "requested",
        ClaimKind::Stated => "stated",
    }
}

fn held(proof: &Proof, result: &ClaimResult) -> String {
    let all = u64::from(proof.size[0]) * u64::from(proof.size[1]);
    let capped = match result.capped_pieces {
        0 => String::new(),
        pieces => format!("; the reference did not converge on {pieces} pieces of rays"),
    };
    let rounding = if proof.are_pixels_rounded { ", of which rounding to 8 bits is up to 0.5" } else { "" };
    format!(
        "proved; {} of {all} pixels cast again keep {}: largest difference {}{rounding}{capped}",
        proof.pixels,
        claimed(&result.claim),
        rounded(result.largest_grey_levels),
    )
}

fn refuted(proof: &Proof, result: &ClaimResult) -> String {
    let wrong: Vec<String> = result.wrong.iter().map(wrong_pixel).collect();
    let more = match result.wrong_pixels - result.wrong.len() as u64 {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let changed = match proof.are_pixels_unchanged {
        true => "",
        false => ". Its pixels are not those that were written, as their checksum shows",
    };
    format!(
        "not proved: {} of {} cast again break {}: {}{more}{changed}",
        result.wrong_pixels,
        counted(proof.pixels, "pixel"),
        claimed(&result.claim),
        wrong.join("; "),
    )
}

fn wrong_pixel(wrong: &WrongPixel) -> String {
    let WrongPixel { pixel: [x, y], channel, found, expected, allowed } = *wrong;
    format!(
        "pixel {x},{y}, {}: found {}, expected {} within {}",
        CHANNELS[channel],
        rounded(found),
        rounded(expected),
        rounded(allowed)
    )
}

/// Grey levels with three decimals at most.
fn rounded(grey_levels: f64) -> String {
    let text = format!("{grey_levels:.3}");
    text.trim_end_matches('0').trim_end_matches('.').into()
}

/// Failure of a proof that could not be made.
fn with_error(error: Error) -> Failure {
    match error {
        Error::Stored(error) => with_stored(error),
        Error::Proof { path, source } => with_proof(&path, *source),
        error => with_picture(error),
    }
}

fn with_stored(error: StoredError) -> Failure {
    let message = error.to_string();
    match error {
        StoredError::Io { path, .. } if !path.exists() => {
            Failure::Command(format!("{}: there is no such file", path.display()))
        }
        StoredError::Io { source, .. } if source.kind() != std::io::ErrorKind::InvalidInput => {
            Failure::Machine(message)
        }
        StoredError::Io { .. } => Failure::Command(message),
        _ => Failure::Data(message),
    }
}

fn with_proof(path: &Path, error: ProofError) -> Failure {
    let option = match &error {
        ProofError::TooLarge { needed_bytes, .. } => format!(" (option --memory {})", show_bytes(*needed_bytes)),
        ProofError::NoRecord => " (.npy with --record)".into(),
        ProofError::SceneFile { .. } => ". Name its folder with --files".into(),
        _ => String::new(),
    };
    let message = format!("{}: {error}{option}", path.display());
    match error.kind() {
        ErrorKind::Request => Failure::Command(message),
        ErrorKind::Data => Failure::Data(message),
        ErrorKind::Machine | ErrorKind::Cancelled => Failure::Machine(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_pixels_are_numbers_or_all() {
        assert_eq!((pixels("20"), pixels("all")), (Ok(20), Ok(u64::MAX)));
        assert!(["0", "-1", "x", ""].iter().all(|text| pixels(text).is_err()));
        assert_eq!([0.5, 12.0, 0.0004].map(rounded), ["0.5", "12", "0"]);
    }
}
