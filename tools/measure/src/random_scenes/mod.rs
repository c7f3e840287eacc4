//! Random scenes: whether the default keeps the requested error.
//!
//! Each scene ([`RandomScene`]) is built into a container and drawn by the default method in one mode, at every error
//! of [`ERRORS`]. Each pixel is compared with the reference integrator. Tests draw a few scenes, and
//! `supervol bench --random-scenes N` draws any number. Scene K of seed S is the same in both.
//!
//! Scenes of a volume that exists have random cameras, transfer functions, lights and cuts ([`members_for`]).

mod generate;

use std::fmt::Write;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use supervol_format::cast::{single, whole};
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::render::renderer::render;
use supervol_runtime::render::stats::mode_name;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::{Mode, ResolvedScene};

use crate::context::{ChartError, Context, Pace};
use crate::stated::{AtLevel, Pixels};
use crate::volume::{self, Volume, build_options};
pub use generate::{Feature, IMAGE, RandomScene, members_for};

/// Requested errors, grey levels of 255.
pub const ERRORS: [f64; 4] = [0.1, 0.5, 2.0, 8.0];
/// Requested error of pictures of level 1, grey levels.
const ERROR_OF_COARSE: f64 = 0.5;
/// Core of the bricks, voxels along an edge: the smallest one, so that rays cross several bricks.
const CORE: u32 = 16;

/// Options of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Seed of all scenes.
    pub seed: u64,
    /// Number of the first scene.
    pub first: u64,
    /// Number of scenes.
    pub scenes: u64,
    /// Rendering mode.
    pub mode: Mode,
    /// Feature that each scene has.
    pub feature: Feature,
    /// Threads of the renderer and of the reference.
    pub threads: usize,
    /// Backend: packets on the CPU, or a GPU. A GPU predicts no errors for transfer functions with steps.
    pub backend: Backend,
}

/// Results of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// Name of the volume; `None` if each scene has a random one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<String>,
    /// Seed of all scenes.
    pub seed: u64,
    /// Rendering mode.
    pub mode: Mode,
    /// Number of the first scene.
    pub first_scene: u64,
    /// Scenes drawn.
    pub scenes: u64,
    /// Drawn scenes that are not entirely empty.
    pub scenes_that_show_something: u64,
    /// Width and height of each picture, pixels; one ray per pixel.
    pub image: [u32; 2],
    /// Scenes without a result, because the reference integrator did not converge.
    pub scenes_not_judged: Vec<u64>,
    /// Total wall time, seconds.
    pub seconds: f64,
    /// Results by requested error.
    pub errors: Vec<AtError>,
    /// Stated errors of pixels against level 0: of level 0 at every requested error, then of level 1.
    pub stated: Vec<AtLevel>,
}

/// Results of all scenes at one requested error. Errors are in grey levels of 255.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtError {
    /// The requested error (`--max-error`).
    pub asked_grey_levels: f64,
    /// Greatest difference of any channel of any pixel of any scene.
    pub largest_grey_levels: f64,
    /// Scene with the greatest difference.
    pub worst_scene: u64,
    /// 99.9th percentile of the channel differences, over all pixels that are not empty in both pictures.
    pub p999_grey_levels: f64,
    /// Scenes with an error above the requested one.
    pub scenes_above: Vec<u64>,
    /// Comparison with the predicted errors; `None` without predictions.
    pub predicted: Option<AgainstPredicted>,
}

/// Measured errors against predicted ones (`error_predicted` of the statistics).
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct AgainstPredicted {
    /// Scenes with an error above the predicted one.
    pub scenes_above: Vec<u64>,
    /// Greatest ratio of measured to predicted error.
    pub largest_share: f64,
    /// Median of the predicted errors.
    pub median_grey_levels: f64,
}

/// Differences at one requested error, collected scene by scene.
struct Differences {
    sizes: Vec<f32>,
    /// Predicted error of each scene, grey levels; empty for a GPU and transfer functions with steps.
    predicted: Vec<f64>,
    against_predicted: AgainstPredicted,
    at: AtError,
}

impl RandomScene {
    /// Builds the volume into the context's folder and resolves the scene.
    ///
    /// # Errors
    /// If the volume cannot be built.
    pub fn build(&self, context: &Context<'_>) -> Result<(Volume, ResolvedScene), ChartError> {
        let volume = Volume::build(context, "random scene", &self.source, &build_options(CORE))?;
        let members: Vec<&str> = self.members.iter().map(String::as_str).collect();
        let scene = volume.scene(&members)?;
        Ok((volume, scene))
    }
}

/// Options of the default method at level 0 with this requested error, grey levels of 255.
#[must_use]
pub fn aimed_at(grey_levels: f64, threads: usize) -> RenderOptions {
    let max_error = grey_levels / GREY_LEVELS;
    RenderOptions { max_error, predict_error: true, threads: Some(threads), ..volume::finest(Backend::Cpu) }
}

/// Draws the scenes and compares them with the reference: of random volumes, or of one that exists.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn run(context: &Context<'_>, options: Options, volume: Option<&Volume>) -> Result<Found, ChartError> {
    let (start, pace) = (Instant::now(), Pace::new(context.say));
    let mut differences = ERRORS.map(Differences::new);
    let mut finest = ERRORS.map(|asked| Pixels::new(0, asked));
    let mut coarse = Pixels::new(1, ERROR_OF_COARSE);
    let (mut not_judged, mut shown) = (Vec::new(), 0);
    let aimed = |grey_levels| RenderOptions { backend: options.backend, ..aimed_at(grey_levels, options.threads) };
    for number in options.first..options.first + options.scenes {
        let mut built = None;
        let (volume, scene) = match volume {
            Some(volume) => {
                let members = members_for(&volume.facts, (options.mode, options.feature), options.seed, number);
                (volume, volume.scene(&members.iter().map(String::as_str).collect::<Vec<_>>())?)
            }
            None => {
                let (volume, scene) =
                    RandomScene::with(options.mode, options.feature, options.seed, number).build(context)?;
                (&*built.insert(volume), scene)
            }
        };
        let by_reference = RenderOptions { threads: Some(options.threads), ..volume::finest(Backend::Reference) };
        let (exact, stats) = render(&volume.container, &scene, &by_reference)?;
        if stats.reference_capped_pieces > 0 {
            not_judged.push(number);
            continue;
        }
        shown += u64::from(exact.pixels.iter().any(|pixel| pixel[3] > 0.0));
        for (differences, pixels) in differences.iter_mut().zip(&mut finest) {
            let asked = differences.at.asked_grey_levels;
            let (picture, stats) = pixels.draw(number, volume, &scene, &exact, aimed(asked))?;
            let predicted = stats.error_predicted.as_ref().and_then(|predicted| predicted.total.grey_levels);
            if predicted.is_none() && options.backend == Backend::Cpu && options.mode == Mode::Dvr {
                return Err(ChartError::Broken(format!("no prediction: {stats:?}")));
            }
            differences.add(number, &picture, &exact, predicted);
        }
        coarse.draw(number, volume, &scene, &exact, aimed(ERROR_OF_COARSE))?;
        let done = number - options.first + 1;
        pace.tell(|| progress(done, options.scenes, start.elapsed().as_secs_f64(), &differences));
    }
    Ok(Found {
        volume: volume.map(|volume| volume.name.clone()),
        seed: options.seed,
        mode: options.mode,
        first_scene: options.first,
        scenes: options.scenes,
        scenes_that_show_something: shown,
        image: IMAGE,
        scenes_not_judged: not_judged,
        seconds: start.elapsed().as_secs_f64(),
        errors: differences.into_iter().map(Differences::finish).collect(),
        stated: finest.into_iter().chain([coarse]).map(Pixels::finish).collect(),
    })
}

fn progress(done: u64, all: u64, seconds: f64, differences: &[Differences]) -> String {
    let left = seconds / done as f64 * (all - done) as f64;
    let largest: Vec<String> =
        differences.iter().map(|d| format!("{:.3} of {}", d.at.largest_grey_levels, d.at.asked_grey_levels)).collect();
    format!("{done} of {all} scenes, {left:.0} s left; largest errors so far, grey levels: {}", largest.join(", "))
}

impl Differences {
    fn new(asked_grey_levels: f64) -> Self {
        let at = AtError {
            asked_grey_levels,
            largest_grey_levels: 0.0,
            worst_scene: 0,
            p999_grey_levels: 0.0,
            scenes_above: Vec::new(),
            predicted: None,
        };
        Self { sizes: Vec::new(), predicted: Vec::new(), against_predicted: AgainstPredicted::default(), at }
    }

    fn add(&mut self, scene: u64, picture: &Image, exact: &Image, predicted: Option<f64>) {
        let shows = |(a, b): &(&[f32; 4], &[f32; 4])| a[3] != 0.0 || b[3] != 0.0;
        let seen = picture.pixels.iter().zip(&exact.pixels).filter(shows);
        let sizes = seen.flat_map(|(a, b)| [0, 1, 2, 3].map(|c| single(GREY_LEVELS) * (a[c] - b[c]).abs()));
        self.sizes.extend(sizes);
        let error = picture.distance(exact);
        if error > self.at.largest_grey_levels {
            (self.at.largest_grey_levels, self.at.worst_scene) = (error, scene);
        }
        if error > self.at.asked_grey_levels {
            self.at.scenes_above.push(scene);
        }
        if let Some(predicted) = predicted {
            self.predicted.push(predicted);
            let against = &mut self.against_predicted;
            if error > predicted {
                against.scenes_above.push(scene);
            }
            against.largest_share = against.largest_share.max(error / predicted);
        }
    }

    fn finish(mut self) -> AtError {
        self.sizes.sort_by(f32::total_cmp);
        let rank = whole::<usize>((self.sizes.len() as f64 * 0.999).ceil());
        let p999 = self.sizes.get(rank.max(1) - 1).copied().unwrap_or(0.0);
        self.predicted.sort_by(f64::total_cmp);
        let median = self.predicted.get(self.predicted.len() / 2).copied();
        let predicted = median.map(|median| AgainstPredicted { median_grey_levels: median, ..self.against_predicted });
        AtError { p999_grey_levels: f64::from(p999), predicted, ..self.at }
    }
}

impl Found {
    /// Scenes with an error above any requested one, or above what a picture states, each listed once.
    #[must_use]
    pub fn scenes_above(&self) -> Vec<u64> {
        let asked = self.errors.iter().flat_map(|at| &at.scenes_above);
        let mut scenes: Vec<u64> =
            asked.chain(self.stated.iter().flat_map(|at| &at.scenes_above_stated)).copied().collect();
        scenes.sort_unstable();
        scenes.dedup();
        scenes
    }

    /// Greatest ratio of measured to requested error.
    #[must_use]
    pub fn greatest_share(&self) -> f64 {
        greatest(self.errors.iter().map(|at| at.largest_grey_levels / at.asked_grey_levels))
    }
}

/// Writes `random-scenes.md` (the page) and `random-scenes.json` (the numbers) into a folder.
///
/// The numbers of volumes that exist are a list, `volumes`.
///
/// # Errors
/// If a file cannot be written.
pub fn write(found: &[Found], page: &str, folder: &Path) -> Result<(), ChartError> {
    let cannot = |path: &Path, source| ChartError::Write { path: path.into(), source };
    std::fs::create_dir_all(folder).map_err(|e| cannot(folder, e))?;
    let numbers = match found {
        [random] if random.volume.is_none() => serde_json::to_string_pretty(random),
        volumes => serde_json::to_string_pretty(&serde_json::json!({ "volumes": volumes })),
    };
    let numbers = numbers.map_err(|e| ChartError::Broken(format!("numbers without JSON: {e}")))?;
    for (name, text) in [("random-scenes.md", page), ("random-scenes.json", &(numbers + "\n"))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| cannot(&path, e))?;
    }
    Ok(())
}

/// Reason why writing into a string cannot fail.
const WRITES: &str = "strings take everything";

/// The results as Markdown tables, those of each volume under its name.
///
/// # Panics
/// Never: writing into a string does not fail.
#[must_use]
pub fn markdown(found: &[Found], command: &str) -> String {
    let mut text =
        format!("Errors are distances from the reference integrator, in grey levels of 255.\n\n    {command}\n");
    found.iter().for_each(|found| text.push_str(&tables(found)));
    text
}

fn tables(found: &Found) -> String {
    let [width, height] = found.image;
    let last = found.first_scene + found.scenes.saturating_sub(1);
    let mut text = format!(
        "\nRandom scenes {} to {last} of seed {}{}, mode {}, {width} x {height} pixels, {} of {} show something; {:.0} s.\n\n\
         | error asked for | largest error | in scene | 99.9th percentile | scenes above | predicted, median | largest of \
         predicted | scenes above predicted |\n|---|---|---|---|---|---|---|---|\n",
        found.first_scene,
        found.seed,
        found.volume.as_ref().map_or(String::new(), |volume| format!(" of {volume}")),
        mode_name(found.mode),
        found.scenes_that_show_something,
        found.scenes,
        found.seconds
    );
    for at in &found.errors {
        let against = at.predicted.as_ref().map_or("- | - | -".into(), |predicted| {
            let AgainstPredicted { scenes_above, largest_share, median_grey_levels } = predicted;
            format!("{median_grey_levels:.2} | {largest_share:.2} | {}", counted(scenes_above))
        });
        writeln!(
            text,
            "| {} | {:.4} | {} | {:.4} | {} | {against} |",
            at.asked_grey_levels,
            at.largest_grey_levels,
            at.worst_scene,
            at.p999_grey_levels,
            counted(&at.scenes_above),
        )
        .expect(WRITES);
    }
    text.push_str(&stated_table(&found.stated));
    if !found.scenes_not_judged.is_empty() {
        let numbers = &found.scenes_not_judged;
        writeln!(text, "\nNot judged, because the reference did not stand still: scenes {numbers:?}.").expect(WRITES);
    }
    text
}

/// Stated errors of pixels as a table; empty if there are none.
fn stated_table(stated: &[AtLevel]) -> String {
    if stated.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "\nWhat is stated of each pixel (`error_stated`) against the exact picture of level 0, over the pixels that are more \
         than 0.01 off:\n\n| level drawn | error asked for | pixels | true, median | stated, median | stated / true, median | \
         largest stated | largest true / stated | pixels with a bound below 254 | scenes above stated |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for at in stated {
        writeln!(
            text,
            "| {} | {} | {} | {:.3} | {:.3} | {:.1} | {:.3} | {:.2} | {:.0} % | {} |",
            at.level,
            at.asked_grey_levels,
            at.pixels,
            at.median_true_grey_levels,
            at.median_stated_grey_levels,
            at.median_stated_over_true,
            at.largest_stated_grey_levels,
            at.largest_share_of_stated,
            100.0 * at.share_with_a_bound,
            counted(&at.scenes_above_stated)
        )
        .expect(WRITES);
    }
    text
}

/// Number of scenes and the numbers of the first ten.
fn counted(scenes: &[u64]) -> String {
    let named: Vec<String> = scenes.iter().take(10).map(u64::to_string).collect();
    if named.is_empty() { "0".into() } else { format!("{}: {}", scenes.len(), named.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_the_same_whenever_they_are_drawn_and_all_differ() {
        let members = |number| RandomScene::new(7, number).members;
        assert_eq!(members(3), members(3));
        assert!(members(3) != members(4) && members(3) != RandomScene::new(8, 3).members);
        let by_gradient = RandomScene::with(Mode::Dvr, Feature::GradientOpacity, 7, 3).members;
        assert_eq!(by_gradient[..by_gradient.len() - 1], members(3), "the rest of the scene stays");
        assert!(by_gradient[by_gradient.len() - 1].starts_with("\"gradient_opacity\": ["), "{by_gradient:?}");
        let cut: Vec<String> =
            (0..200).flat_map(|number| RandomScene::with(Mode::Dvr, Feature::CutNormals, 7, number).members).collect();
        for part in
            ["\"box\": [[", "\"planes\": [{", "sphere", "cylinder", "axes", "inside", "outside", "gradient_opacity"]
        {
            assert!(cut.iter().filter(|member| member.contains(part)).count() > 10, "hardly any scene has {part}");
        }
        assert_eq!(cut.iter().filter(|member| *member == "\"cut_normals\": true").count(), 200);
        assert_eq!(cut.iter().filter(|member| member.starts_with("\"clip\": ")).count(), 200);
        let all: Vec<String> = (0..200).flat_map(members).collect();
        for part in ["\"height\": ", "\"fov_y\": ", "\"shading\": {}", "\"lights\"", "\"box\"", "\"planes\""] {
            assert!(all.iter().filter(|member| member.contains(part)).count() > 10, "hardly any scene has {part}");
        }
    }

    #[test]
    fn scenes_above_the_error_are_counted_and_named() {
        let exact = Image { width: 2, height: 1, pixels: vec![[0.5, 0.5, 0.5, 1.0], [0.0; 4]] };
        let mut off = exact.clone();
        off.pixels[0][1] += 0.75 / 255.0;
        let mut differences = Differences::new(0.5);
        differences.add(11, &exact, &exact, Some(0.6));
        differences.add(12, &off, &exact, Some(0.6));
        assert_eq!(differences.sizes.len(), 8, "pixels that show nothing do not count");
        let at = differences.finish();
        assert!((at.largest_grey_levels - 0.75).abs() < 1e-3 && at.worst_scene == 12, "{at:?}");
        assert_eq!(
            (at.scenes_above.as_slice(), at.p999_grey_levels),
            (&[12u64][..], at.largest_grey_levels as f32 as f64)
        );
        let predicted = at.predicted.as_ref().expect("predictions");
        assert_eq!((predicted.scenes_above.as_slice(), predicted.median_grey_levels), (&[12u64][..], 0.6));
        let found = Found {
            volume: None,
            seed: 1,
            mode: Mode::Dvr,
            first_scene: 11,
            scenes: 2,
            scenes_that_show_something: 2,
            image: IMAGE,
            scenes_not_judged: vec![],
            seconds: 1.0,
            errors: vec![at],
            stated: vec![Pixels::new(1, 0.5).finish()],
        };
        assert_eq!(found.scenes_above(), [12]);
        let text = markdown(&[found], "supervol bench");
        assert!(text.contains("| 0.5 | 0.7500 | 12 |") && text.contains("| 1: 12 |"), "{text}");
    }
}
