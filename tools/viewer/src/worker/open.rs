//! Opening of files. For a source file, a container is built in the cache folder once, on a thread of its own. For a
//! large volume, a preview is available meanwhile.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use supervol::{Canceller, Volume};
use supervol_arguments::flags;
use supervol_format::Container;
use supervol_format::coordinates::Coordinates;
use supervol_preprocess::kept::{Cache, Told};
use supervol_preprocess::preview::Preview;
use supervol_preprocess::{BuildError, BuildOptions};
use supervol_scene::scene::Scene;
use supervol_sources::open::split_array;
use supervol_sources::{SourceError, Survey};

use super::messages::{Busy, Message, Open, OpenVolume, Refused, Settings};
use super::shared::{Shared, lock};

/// Interval between two progress reports.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Opens a container and completes the scene for it, or returns the message of the failure.
pub(super) fn open(path: &Path, request: Open, number: u64) -> Result<Arc<OpenVolume>, Message> {
    let failure = |error| Message::Failure(format!("{}: {error}", path.display()));
    let container = match Container::open(path) {
        Err(_) if !split_array(path).0.exists() => return Err(missing(path)),
        opened => opened.map_err(failure)?,
    };
    opened(container, request, number, None)
}

/// The open volume for a preview, which is used until the container is built.
pub(super) fn open_preview(preview: Preview, request: Open, number: u64) -> Result<Arc<OpenVolume>, Message> {
    opened(preview.container, request, number, Some(preview.strides))
}

fn opened(
    container: Container,
    request: Open,
    number: u64,
    preview_of: Option<[u64; 3]>,
) -> Result<Arc<OpenVolume>, Message> {
    let path = container.path().to_path_buf();
    let exaggerated = Scene { vertical_exaggeration: Some(request.exaggeration), ..Scene::default() };
    let volume = Volume::of(container);
    let placed = volume.placed_for(&exaggerated).map_err(|e| Message::Failure(e.to_string()))?;
    // Reads the overview here, so that edits in the window never wait for it.
    let overview = placed.overview();
    let mut scene = request.scene.complete(placed.facts(), overview);
    scene.vertical_exaggeration = exaggerated.vertical_exaggeration.filter(|factor| *factor != 1.0);
    let has_requested_camera = request.scene.camera.is_some();
    let survey = Survey::of(placed.container().manifest());
    let coordinates = Coordinates::of(placed.container());
    let Open { path: source, reading, exaggeration, .. } = request;
    Ok(Arc::new(OpenVolume {
        number,
        source,
        reading,
        path,
        preview_of,
        volume,
        placed,
        survey,
        coordinates,
        exaggeration,
        scene,
        has_requested_camera,
    }))
}

/// Starts a thread that builds the container of a source file. The thread reports a preview and then the container to
/// the shared state. Only one build runs at a time: it waits for the end of the previous, cancelled build.
pub(super) fn begin_build(
    shared: &Arc<Shared>,
    (request, number): (Open, u64),
    (settings, canceller): (&Settings, Canceller),
    before: Option<JoinHandle<()>>,
) -> std::io::Result<JoinHandle<()>> {
    let (shared, settings) = (shared.clone(), *settings);
    std::thread::Builder::new().name("supervol-build".into()).spawn(move || {
        // A panic message is on standard error already.
        let _ = before.map(JoinHandle::join);
        let build = || build_container(&shared, (&request, number), &settings, canceller);
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(build)).unwrap_or_else(|_| {
            Err(Message::Failure(
                "the build has crashed because of a bug in supervol; its message is on standard error".into(),
            ))
        });
        shared.request(|requests| requests.built = Some((number, result)));
    })
}

/// Message for a failed or stopped build, with advice. A stopped build continues when the file is opened again.
fn build_failure(error: &BuildError, source: &Path) -> Message {
    match error {
        BuildError::Stopped { kept: Some(_) } => {
            Message::Done(format!("the build of {} was stopped; open the file again to continue it", source.display()))
        }
        _ if error.is_stopped() => {
            Message::Done(format!("the build of {} was stopped before it had finished any part", source.display()))
        }
        _ if !split_array(source).0.exists() => missing(source),
        _ if may_need_options(error) => {
            let advice = "Some files need options (for example --dims). Choose them in the window File options.";
            Message::Failure(format!("{}\n{advice}", flags::message(error)))
        }
        _ => Message::Failure(flags::message(error)),
    }
}

/// Message for a file that is not there.
fn missing(path: &Path) -> Message {
    Message::Failure(format!("{} does not exist. Check the name, or open another file.", path.display()))
}

/// Whether options may help against an error. The window knows the channels and time points that it asks for.
fn may_need_options(error: &BuildError) -> bool {
    use SourceError::{Invalid, Options, RawLength, Unsupported};
    let BuildError::Source(error) = error else { return false };
    matches!(error, Unsupported { .. } | Invalid { .. } | RawLength { .. } | Options(_))
}

/// The refusal of a file that may be read with other options.
fn refusal(error: &BuildError, source: &Path) -> Option<Box<Refused>> {
    let BuildError::Source(of_source) = error else { return None };
    let is_there = split_array(source).0.exists();
    (is_there && may_need_options(error)).then(|| {
        let choices = of_source.choices().to_vec();
        Box::new(Refused { source: source.into(), why: flags::message(error), choices })
    })
}

/// The container of a source file in the cache folder: an existing one, or a new one.
fn build_container(
    shared: &Shared,
    (request, number): (&Open, u64),
    settings: &Settings,
    canceller: Canceller,
) -> Result<PathBuf, Message> {
    let (source, folders) = (request.path.as_path(), &shared.folders);
    let options = BuildOptions::default();
    let options = BuildOptions { threads: settings.threads.unwrap_or(options.threads), canceller, ..options };
    let last = std::sync::Mutex::new(None::<Instant>);
    let told = |told: Told<'_>| match told {
        Told::Building(_) => {}
        Told::Preview(preview) => shared.request(|requests| requests.preview = Some((number, preview))),
        Told::Progress(progress) => {
            let mut last = lock(&last);
            if last.is_none_or(|at| at.elapsed() >= PROGRESS_INTERVAL) {
                *last = Some(Instant::now());
                shared.report_build(number, Busy::Building(source.into(), progress));
            }
        }
    };
    let cache = Cache::below(folders.cache.as_deref(), folders.cache_limit_bytes).map(Cache::with_previews);
    cache.and_then(|cache| cache.container_of(source, &request.reading, &options, &told)).map_err(|error| {
        shared.send(|messages| messages.refused = refusal(&error, source));
        build_failure(&error, source)
    })
}
