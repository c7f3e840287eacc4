//! Latency of the viewer from an input to the first picture that shows it. A script drives the worker, without a
//! window.
//!
//!     cargo run --release -p supervol-viewer --example latency -- VOLUME.svol [WIDTHxHEIGHT] [HOST_MEMORY_MIB] [THREADS] [gpu]
//!
//! Three series are measured:
//!
//! 1. A drag that turns the volume by two degrees whenever a picture has come.
//! 2. The same steps one by one, each from a converged picture.
//! 3. A section across the grid's last axis, in a panel of half the size, that moves through the volume whenever its
//!    picture has come. The picture of the volume is converged.
//!
//! Both wall time and processor time of a step are printed, because other programs may run. The time to put a picture
//! on the screen is not included.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]

use std::process::ExitCode;
use std::time::{Duration, Instant};

use supervol::Backend;
use supervol::runtime::render::process::cpu_time;
use supervol_preprocess::kept::Reading;
use supervol_scene::preset::slices::plane_across;
use supervol_scene::scene::Scene;
use supervol_scene::scene::section::face_on;
use supervol_scene::slices::{Interpolation, SliceSpec};
use supervol_viewer::folders::Folders;
use supervol_viewer::worker::{Frame, Message, Messages, Open, OpenVolume, Settings, SidePanels, View, Worker};
use supervol_viewer::{edit, navigate};

const DRAG_STEPS: usize = 180;
const SINGLE_STEPS: usize = 10;
const SECTION_STEPS: usize = 60;
/// The axis along which sections move.
const AXIS: usize = 2;
const PATIENCE: Duration = Duration::from_secs(600);

struct Hand {
    worker: Worker,
    request_added: crossbeam_channel::Receiver<()>,
    number: u64,
    /// The last received picture.
    last: Option<Frame>,
}

impl Hand {
    /// Waits for messages that contain a wanted item.
    fn wait<T>(&self, mut take: impl FnMut(Messages) -> Option<T>) -> Result<T, String> {
        let start = Instant::now();
        loop {
            // The channel may hold a signal of older messages. Nothing is missed, because the signal is sent after the
            // messages are stored.
            let _ = self.request_added.recv_timeout(Duration::from_secs(1));
            let mut messages = self.worker.messages();
            if let Some(Message::Failure(message)) = messages.message.take() {
                return Err(message);
            }
            if let Some(found) = take(messages) {
                return Ok(found);
            }
            if start.elapsed() > PATIENCE {
                return Err("the worker tells nothing".into());
            }
        }
    }

    /// Requests a scene; returns the milliseconds to its first picture.
    fn request(&mut self, opened: &OpenVolume, scene: &Scene) -> Result<f64, String> {
        self.number += 1;
        let (start, number) = (Instant::now(), self.number);
        self.worker.view(View { number, volume: opened.number, scene: scene.clone() });
        self.last = Some(self.wait(|messages| messages.frame.filter(|frame| frame.number == number))?);
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Requests a section; returns the milliseconds to its first picture and to the converged one.
    fn request_section(&mut self, opened: &OpenVolume, scene: &Scene) -> Result<[f64; 2], String> {
        self.number += 1;
        let (start, number) = (Instant::now(), self.number);
        self.worker.section(AXIS, View { number, volume: opened.number, scene: scene.clone() });
        let section = |mut messages: Messages| messages.sections[AXIS].take().filter(|frame| frame.number == number);
        let mut frame = self.wait(section)?;
        let first = start.elapsed().as_secs_f64() * 1e3;
        while !frame.is_converged {
            frame = self.wait(section)?;
        }
        Ok([first, start.elapsed().as_secs_f64() * 1e3])
    }

    /// Waits until the picture has converged; returns the milliseconds.
    fn rest(&mut self) -> Result<f64, String> {
        let last = match self.last.take() {
            Some(frame) if frame.is_converged => frame,
            _ => self.wait(|messages| messages.frame.filter(|frame| frame.is_converged))?,
        };
        Ok(self.last.insert(last).spent_ms)
    }
}

fn quantile(times: &mut [f64], share: f64) -> f64 {
    times.sort_by(f64::total_cmp);
    times[((times.len() - 1) as f64 * share).round() as usize]
}

/// Printed at once, because pictures of large volumes may take minutes to converge.
#[allow(clippy::print_stdout, reason = "it is what this program is for")]
fn tell(name: &str, times: &mut [f64]) {
    let [median, p95] = [0.5, 0.95].map(|share| quantile(times, share));
    println!("{name}: median {median:.0} ms, 95th percentile {p95:.0} ms, {} steps", times.len());
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Moves a section through the volume; prints the times to the first and to the converged pictures.
#[allow(clippy::print_stdout, reason = "it is what this program is for")]
fn sections(
    hand: &mut Hand,
    opened: &OpenVolume,
    settings: Settings,
    [width, height]: [u32; 2],
) -> Result<[Vec<f64>; 2], String> {
    hand.worker.set(Settings { side_panels: SidePanels::Shown, ..settings });
    let facts = opened.facts();
    let (cpu, mut times) = (cpu_time(), [Vec::new(), Vec::new()]);
    for step in 0..SECTION_STEPS {
        let at = (facts.dims.0[AXIS] - 1) as f64 * step as f64 / (SECTION_STEPS - 1) as f64;
        let (normal, offset) = plane_across(facts, AXIS, at.round());
        let interpolation = Interpolation::Linear;
        let slice =
            SliceSpec { normal, offset, opacity: 1.0, interpolation, filter: None, colors: Vec::new(), labels: false };
        let mut open = Scene { samples_per_pixel: Some(1), ..Scene::default() };
        (open.image.width, open.image.height) = (width, height);
        let scene = face_on(&open, facts, slice, 1.0).ok_or("there is no such section")?.complete(facts, None);
        for (times, time) in times.iter_mut().zip(hand.request_section(opened, &scene)?) {
            times.push(time);
        }
    }
    println!("sections: {:.0} ms of processor time each", milliseconds(cpu_time() - cpu) / SECTION_STEPS as f64);
    Ok(times)
}

#[allow(clippy::print_stdout, reason = "it is what this program is for")]
fn run() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().ok_or("expected: VOLUME.svol [WIDTHxHEIGHT] [HOST_MEMORY_MIB] [THREADS] [gpu]")?;
    let size = arguments.get(1).map_or("760x760", String::as_str);
    let size: Vec<u32> = size.split('x').filter_map(|n| n.parse().ok()).collect();
    let &[width, height] = size.as_slice() else { return Err("expected WIDTHxHEIGHT".into()) };
    let number = |i: usize| arguments.get(i).and_then(|n| n.parse::<u64>().ok());
    let mut settings = Settings { threads: number(3).map(|n| n as usize), ..Settings::default() };
    if arguments.get(4).is_some_and(|backend| backend == "gpu") {
        settings.backend = Backend::Gpu;
    }
    settings.host_memory_bytes = number(2).map_or(settings.host_memory_bytes, |mebibytes| mebibytes << 20);

    let start = Instant::now();
    let (ring, request_added) = crossbeam_channel::bounded(1);
    let worker = Worker::start(settings, Folders::default(), move || {
        // One pending signal suffices.
        let _ = ring.try_send(());
    })
    .map_err(|e| e.to_string())?;
    let mut hand = Hand { worker, request_added, number: 0, last: None };
    hand.worker.open(Open {
        path: path.into(),
        reading: Reading::default(),
        exaggeration: 1.0,
        scene: Scene::default(),
    });
    let opened = hand.wait(|messages| messages.opened)?;
    let mut scene = opened.scene.clone();
    (scene.image.width, scene.image.height) = (width, height);
    hand.request(&opened, &scene)?;
    println!("first picture: {:.0} ms after the start", start.elapsed().as_secs_f64() * 1e3);

    let stage = edit::stage(opened.facts());
    let turn = |scene: &mut Scene| {
        scene.camera = scene.camera.as_ref().map(|camera| navigate::orbit(camera, &stage, [2.0, 0.0]));
    };
    let cpu = cpu_time();
    let mut dragged = Vec::new();
    for _ in 0..DRAG_STEPS {
        turn(&mut scene);
        dragged.push(hand.request(&opened, &scene)?);
    }
    println!("dragged: {:.0} ms of processor time a step", milliseconds(cpu_time() - cpu) / DRAG_STEPS as f64);
    tell("dragged", &mut dragged);
    let mut single = Vec::new();
    let mut converged = Vec::new();
    for _ in 0..SINGLE_STEPS {
        hand.rest()?;
        turn(&mut scene);
        single.push(hand.request(&opened, &scene)?);
        converged.push(hand.rest()?);
    }
    tell("from rest", &mut single);
    tell("to convergence", &mut converged);
    hand.rest()?;
    let [mut sections, mut finished] = sections(&mut hand, &opened, settings, [width / 2, height / 2])?;
    tell("sections", &mut sections);
    tell("sections to convergence", &mut finished);
    Ok(())
}

#[allow(clippy::print_stderr, reason = "why it failed")]
fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("latency: {message}");
            ExitCode::FAILURE
        }
    }
}
