//! VTK's CPU ray caster, `vtkFixedPointVolumeRayCastMapper`, in a Python process of its own.
//!
//! One process draws one case. It reads a job as JSON and writes numbers as JSON and pictures as raw 16-bit RGBA;
//! `vtk_render.py` describes the details. Known differences from Supervol's model:
//! - samples are points at equal distances, opacity is corrected by a table, all arithmetic is 15-bit fixed point;
//! - gradients are central differences at the voxels, rounded to a table of directions, made once (in the first
//!   picture);
//! - highlights use the camera's direction instead of each ray's;
//! - a ray ends when its opacity reaches [`TERMINATION_OPACITY`], which may cost two grey levels;
//! - there are no absent voxels: volumes with absent voxels are not compared.
//!
//! Its answers are not trusted: sizes of pictures and lists are checked.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};
use supervol_scene::camera::Projection;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::transfer_function::ControlPoint;

use super::cases::Case;
use super::environment::{self, Package};
use super::options::{PeerOptions, Run};
use super::results::{Cost, Drawn, PeerReport, Versions, sampling_name};
use crate::context::{ChartError, Context, Pace};
use crate::measure::Spread;

/// Program name of the peer's rows.
pub const NAME: &str = "VTK";
/// The installed package.
pub const PACKAGE: Package = Package { name: "vtk", version: "9.7.2" };
/// Opacity at which VTK ends a ray: its transmittance falls below 255 of 32768.
pub const TERMINATION_OPACITY: f64 = 1.0 - 255.0 / 32768.0;

/// Full scale of a channel of VTK's pictures.
const ONE: f32 = 32767.0;
const SCRIPT: &str = include_str!("vtk_render.py");
/// Time limit of the pictures of one case.
const CASE_LIMIT: Duration = Duration::from_secs(600);
/// Largest answer that is read, bytes.
const ANSWER_LIMIT_BYTES: u64 = 1 << 20;

/// The peer while it works. After its first failure the comparison continues without it.
#[derive(Debug)]
pub struct Peer {
    python: Option<PathBuf>,
    report: PeerReport,
}

impl Peer {
    /// Makes the environment if it does not exist yet.
    #[must_use]
    pub fn prepare(options: &PeerOptions, say: &(dyn Fn(&str) + Sync)) -> Self {
        let mut report = PeerReport { name: NAME, measured: true, why_not: None, versions: None };
        let python = environment::prepare(options, PACKAGE, say);
        if let Err(why) = &python {
            refuse(&mut report, why);
        }
        Self { python: python.ok(), report }
    }

    /// Report about the peer.
    #[must_use]
    pub fn into_report(self) -> PeerReport {
        self.report
    }

    /// Draws a case at every step; empty if the peer does not work.
    ///
    /// # Errors
    /// If the job cannot be written.
    pub fn draw(&mut self, context: &Context<'_>, case: &Case<'_>, run: &Run) -> Result<Vec<Drawn>, ChartError> {
        let Some(python) = self.python.clone() else { return Ok(Vec::new()) };
        let answer = if case.built.has_holes() {
            Err("the volume has absent voxels, which it does not know".into())
        } else {
            Job::write(context, case, run)?.run(&python, context.say)
        };
        match answer {
            Ok((versions, drawn)) => {
                self.report.versions = Some(versions);
                Ok(drawn)
            }
            Err(why) => {
                refuse(&mut self.report, &format!("{}: {why}", case.name()));
                (context.say)(&format!("{NAME} is not measured any further: {why}"));
                self.python = None;
                Ok(Vec::new())
            }
        }
    }
}

fn refuse(report: &mut PeerReport, why: &str) {
    report.measured = false;
    report.why_not = Some(why.into());
}

/// Answer of the script.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Answer {
    Failed { error: String },
    Done(Box<Done>),
}

#[derive(Debug, Deserialize)]
struct Done {
    python: String,
    vtk: String,
    numpy: String,
    window: String,
    threads: usize,
    steps: Vec<Step>,
}

#[derive(Debug, Deserialize)]
struct Step {
    first: Time,
    frames: Vec<Time>,
    casts: Vec<Time>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Time {
    cpu_ms: f64,
    wall_ms: f64,
}

/// Files of a job.
struct Job<'a> {
    script: PathBuf,
    job: PathBuf,
    answer: PathBuf,
    /// Step in smallest voxel spacings, and picture file.
    steps: Vec<(f64, PathBuf)>,
    run: &'a Run,
}

impl<'a> Job<'a> {
    fn write(context: &Context<'_>, case: &Case<'_>, run: &'a Run) -> Result<Self, ChartError> {
        let stem = case.name();
        let file = |name: String| context.folder.join(name);
        let steps = run.sizes.steps_voxels.iter().enumerate();
        let steps: Vec<_> = steps.map(|(i, &step)| (step, file(format!("{stem}-{i}.rgba")))).collect();
        let mut text = picture(&case.scene(run.sizes.image)?)?;
        let facts = &case.built.volume.facts;
        text["voxels"] = json!(case.built.grid_file(context)?);
        text["dims"] = json!(facts.dims.0);
        text["spacing"] = json!(facts.geometry.spacing);
        text["origin"] = json!(facts.geometry.origin);
        text["direction"] = json!(facts.geometry.direction);
        text["threads"] = run.threads.into();
        text["repeats"] = run.sizes.repeats.into();
        let step_world = |step: f64| step * case.smallest_spacing();
        let listed = steps.iter().map(|(step, picture)| json!({"step_world": step_world(*step), "picture": picture}));
        text["steps"] = listed.collect();
        let job = Self {
            script: file("vtk_render.py".into()),
            job: file(format!("{stem}-job.json")),
            answer: file(format!("{stem}-answer.json")),
            steps,
            run,
        };
        for (path, bytes) in [(&job.script, SCRIPT.into()), (&job.job, text.to_string())] {
            std::fs::write(path, bytes).map_err(|source| ChartError::Write { path: path.clone(), source })?;
        }
        Ok(job)
    }

    fn run(&self, python: &Path, say: &(dyn Fn(&str) + Sync)) -> Result<(Versions, Vec<Drawn>), String> {
        let pace = Pace::new(say);
        let tell = |elapsed: Duration| pace.tell(|| format!("  {NAME} draws: {} s", elapsed.as_secs()));
        environment::run_telling(python, &[&self.script, &self.job, &self.answer], CASE_LIMIT, &tell)?;
        let bytes = std::fs::metadata(&self.answer).map_err(|e| format!("there is no answer: {e}"))?.len();
        if bytes > ANSWER_LIMIT_BYTES {
            return Err(format!("the answer has {bytes} bytes, more than {ANSWER_LIMIT_BYTES}"));
        }
        let text = std::fs::read_to_string(&self.answer).map_err(|e| format!("the answer cannot be read: {e}"))?;
        let done = parse(&text, self.steps.len(), self.run.sizes.repeats, self.run.threads)?;
        let drawn = self.steps.iter().zip(&done.steps).map(|(files, step)| self.drawn(files, step));
        let drawn = drawn.collect::<Result<_, String>>()?;
        Ok((Versions { vtk: done.vtk, python: done.python, numpy: done.numpy, window: done.window }, drawn))
    }

    fn drawn(&self, (step_voxels, picture): &(f64, PathBuf), step: &Step) -> Result<Drawn, String> {
        Ok(Drawn {
            program: NAME,
            sampling: sampling_name(*step_voxels),
            step_voxels: Some(*step_voxels),
            cost: step.cost(),
            picture: read_picture(picture, self.run.sizes.image)?,
        })
    }
}

/// A scene in the form of the script: perspective, one ray per pixel, light from the eye.
fn picture(scene: &ResolvedScene) -> Result<Value, ChartError> {
    let camera = &scene.camera;
    let Projection::Perspective { fov_y } = camera.projection else {
        return Err(ChartError::Broken("a picture with an orthographic camera is compared".into()));
    };
    let target = camera.eye + camera.forward;
    let function = &scene.transfer_function;
    let point = |p: &ControlPoint| json!({"value": p.value, "color": p.color, "alpha": p.alpha});
    let shading = scene
        .shading
        .as_ref()
        .map(|s| json!({"ambient": s.ambient, "diffuse": s.diffuse, "specular": s.specular, "shininess": s.shininess}));
    Ok(json!({
        "camera": {
            "eye": camera.eye.to_array(), "target": target.to_array(), "up": camera.up.to_array(), "fov_y": fov_y,
        },
        "transfer_function": {
            "unit_distance": function.unit_distance(),
            "points": function.points().iter().map(point).collect::<Vec<_>>(),
        },
        "shading": shading,
        "image": scene.image_size,
    }))
}

impl Step {
    fn cost(&self) -> Cost {
        let spread = |times: &[Time], of: fn(&Time) -> f64| Spread::of(&times.iter().map(of).collect::<Vec<_>>());
        Cost {
            repeats: self.frames.len(),
            cpu: spread(&self.frames, |t| t.cpu_ms),
            wall: spread(&self.frames, |t| t.wall_ms),
            first_cpu_ms: self.first.cpu_ms,
            cast_cpu: Some(spread(&self.casts, |t| t.cpu_ms)),
        }
    }
}

/// Parses and checks the answer: numbers of steps and times as requested, positive times, threads as requested.
fn parse(text: &str, steps: usize, repeats: usize, threads: usize) -> Result<Done, String> {
    let answer = serde_json::from_str(text).map_err(|e| format!("the answer is not understood: {e}"))?;
    let done = match answer {
        Answer::Failed { error } => return Err(error),
        Answer::Done(done) => *done,
    };
    if done.threads != threads {
        return Err(format!("it used {} threads instead of {threads}", done.threads));
    }
    if done.steps.len() != steps {
        return Err(format!("it answered {} step lengths instead of {steps}", done.steps.len()));
    }
    for step in &done.steps {
        let (frames, casts) = (step.frames.len(), step.casts.len());
        if frames != repeats || casts != repeats {
            return Err(format!("it timed {frames} pictures and {casts} casts instead of {repeats}"));
        }
        let mut times = step.frames.iter().chain(&step.casts).chain([&step.first]);
        if let Some(time) = times.find(|time| !(time.cpu_ms > 0.0 && time.wall_ms > 0.0)) {
            return Err(format!("a picture took {} ms of processor time and {} ms", time.cpu_ms, time.wall_ms));
        }
    }
    Ok(done)
}

/// Reads a picture of premultiplied RGBA, 16-bit little endian, row 0 on top; [`ONE`] is 1.
fn read_picture(path: &Path, [width, height]: [u32; 2]) -> Result<Image, String> {
    let expected = u64::from(width) * u64::from(height) * 8;
    let read = || -> std::io::Result<Option<Vec<u8>>> {
        if std::fs::metadata(path)?.len() != expected { Ok(None) } else { std::fs::read(path).map(Some) }
    };
    let bytes = read().map_err(|e| format!("a picture is missing: {e}"))?;
    let bytes = bytes.ok_or_else(|| format!("a picture has not the {expected} bytes of {width} x {height} pixels"))?;
    let channels = bytes.chunks_exact(2).map(|c| f32::from(u16::from_le_bytes([c[0], c[1]])) / ONE);
    let channels: Vec<f32> = channels.collect();
    let pixels = channels.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
    Ok(Image { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"python": "3.11.7", "vtk": "9.7.2", "numpy": "2.4.6", "window": "vtkEGLRenderWindow",
        "threads": 2, "empty": [{"cpu_ms": 0.2, "wall_ms": 0.1}], "steps": [{"first": {"cpu_ms": 9, "wall_ms": 5},
        "frames": [{"cpu_ms": 4, "wall_ms": 2}, {"cpu_ms": 6, "wall_ms": 3}, {"cpu_ms": 5, "wall_ms": 9}],
        "casts": [{"cpu_ms": 3, "wall_ms": 2}, {"cpu_ms": 3, "wall_ms": 2}, {"cpu_ms": 2, "wall_ms": 2}]}]}"#;

    #[test]
    fn a_good_answer_becomes_medians() {
        let done = parse(GOOD, 1, 3, 2).expect("a good answer");
        assert_eq!((done.vtk.as_str(), done.window.as_str()), ("9.7.2", "vtkEGLRenderWindow"));
        let cost = done.steps[0].cost();
        assert_eq!(cost.cpu, Spread { median_ms: 5.0, least_ms: 4.0, greatest_ms: 6.0 });
        assert_eq!((cost.wall.median_ms, cost.first_cpu_ms), (3.0, 9.0));
        assert_eq!(cost.cast_cpu.map(|c| c.median_ms), Some(3.0));
    }

    #[test]
    fn a_failure_is_passed_on_in_its_own_words() {
        let why = parse(r#"{"error": "ImportError: libEGL.so.1"}"#, 1, 3, 2).expect_err("a failure");
        assert_eq!(why, "ImportError: libEGL.so.1");
    }

    #[test]
    fn answers_that_do_not_fit_the_job_are_refused() {
        for (steps, repeats, threads, word) in [(2, 3, 2, "step"), (1, 5, 2, "timed"), (1, 3, 4, "threads")] {
            let why = parse(GOOD, steps, repeats, threads).expect_err("does not fit");
            assert!(why.contains(word), "{why}");
        }
        for wrong in [r#""cpu_ms": -4"#, r#""cpu_ms": 0"#] {
            let why = parse(&GOOD.replace(r#""cpu_ms": 4"#, wrong), 1, 3, 2).expect_err("no time");
            assert!(why.contains("processor time"), "{why}");
        }
        assert!(parse("", 1, 3, 2).expect_err("nothing").contains("not understood"));
        assert!(parse(&GOOD[..200], 1, 3, 2).expect_err("half").contains("not understood"));
    }

    #[test]
    fn a_picture_has_its_size_or_is_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("p.rgba");
        assert!(read_picture(&path, [2, 1]).expect_err("not there").contains("missing"));
        std::fs::write(&path, [0, 0, 0xff, 0x7f, 0, 0, 0xff, 0x7f, 0, 0, 0, 0, 0, 0, 0, 0]).expect("room");
        let picture = read_picture(&path, [2, 1]).expect("a picture");
        assert_eq!(picture.pixels, [[0.0, 1.0, 0.0, 1.0], [0.0; 4]]);
        assert!(read_picture(&path, [2, 2]).expect_err("too short").contains("32 bytes"));
    }
}
