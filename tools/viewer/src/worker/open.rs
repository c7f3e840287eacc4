//! A file to an open volume. What is no container is built into the cache folder first, once.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::Container;
use supervol_preprocess::kept::{Cache, Reading, Told, advice, is_container};
use supervol_preprocess::source::Survey;
use supervol_preprocess::{BuildError, BuildOptions};
use supervol_runtime::facts::VolumeFacts;
use supervol_runtime::preset::overview::Overview;
use supervol_runtime::preset::placing::placed;
use supervol_runtime::stop::Canceller;

use super::{Busy, Desk, Message, Open, Opened, Settings, lock};

/// Progress is told this often.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Opens a volume, and writes out the scene for it; else what there is to say.
pub(super) fn open(
    desk: &Arc<Desk>,
    wish: Open,
    number: u64,
    (settings, canceller): (&Settings, Canceller),
) -> Result<Arc<Opened>, Message> {
    desk.tell(|news| news.busy = Some(Busy::Opening(wish.path.clone())));
    let path = if is_container(&wish.path) {
        wish.path.clone()
    } else {
        built(desk, &wish.path, settings, canceller).map_err(|e| unbuilt(&e, &wish.path))?
    };
    let container = Container::open(&path).map_err(|e| Message::Failure(format!("{}: {e}", path.display())))?;
    let facts = VolumeFacts::of(&container);
    let container = Arc::new(placed(container, &facts, wish.exaggeration));
    let facts = VolumeFacts::of(&container);
    let overview = Overview::read(&container).ok().flatten();
    let mut scene = wish.scene.complete(&facts, overview.as_ref());
    scene.vertical_exaggeration = (wish.exaggeration != 1.0).then_some(wish.exaggeration);
    let is_camera_asked = wish.scene.camera.is_some();
    let survey = Survey::of(container.manifest());
    let Open { path: source, exaggeration, .. } = wish;
    Ok(Arc::new(Opened {
        number,
        source,
        path,
        container,
        facts,
        survey,
        overview,
        exaggeration,
        scene,
        is_camera_asked,
    }))
}

/// Why there is no container of a source, and what to do: opened again, it goes on where somebody has stopped it.
fn unbuilt(error: &BuildError, source: &Path) -> Message {
    match error {
        BuildError::Stopped { kept: Some(_) } => Message::Done(format!(
            "the build of {} was stopped; open it again, and it goes on where it was",
            source.display()
        )),
        _ if error.is_stopped() => {
            Message::Done(format!("the build of {} was stopped before anything was finished", source.display()))
        }
        _ => Message::Failure(format!("{error}\n{}", advice(source))),
    }
}

/// The container of a source file, in the cache folder: the one that is there, or a new one.
fn built(desk: &Desk, source: &Path, settings: &Settings, canceller: Canceller) -> Result<PathBuf, BuildError> {
    let folders = &desk.folders;
    let cache = Cache::below(folders.cache.as_deref(), folders.cache_limit_bytes)?;
    let options = BuildOptions::default();
    let options = BuildOptions { threads: settings.threads.unwrap_or(options.threads), canceller, ..options };
    let last = std::sync::Mutex::new(None::<Instant>);
    cache.container_of(source, &Reading::default(), &options, &|told| {
        let Told::Progress(progress) = told else { return };
        let mut last = lock(&last);
        if last.is_none_or(|at| at.elapsed() >= PROGRESS_INTERVAL) {
            *last = Some(Instant::now());
            desk.tell(|news| news.busy = Some(Busy::Building(source.into(), progress)));
        }
    })
}
