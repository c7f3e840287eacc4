//! A file to an open volume. What is no container is built into the cache folder first, once.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::Container;
use supervol_format::container::header::MAGIC;
use supervol_preprocess::output::folder_of;
use supervol_preprocess::source::open::{OpenOptions, open as open_source};
use supervol_preprocess::source::spool::SpoolFolder;
use supervol_preprocess::{BuildError, BuildOptions, Existing, build, identify};
use supervol_runtime::facts::VolumeFacts;
use supervol_runtime::preset::overview::Overview;
use supervol_runtime::preset::placing::placed;

use super::{Busy, Desk, Open, Opened, Settings};
use crate::folders::container_of;

/// Progress is told this often.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Opens a volume, and writes out the scene for it.
pub(super) fn open(desk: &Arc<Desk>, wish: Open, number: u64, settings: &Settings) -> Result<Arc<Opened>, String> {
    desk.tell(|news| news.busy = Some(Busy::Opening(wish.path.clone())));
    let path = if is_container(&wish.path).map_err(|e| format!("{}: {e}", wish.path.display()))? {
        wish.path.clone()
    } else {
        built(desk, &wish.path, settings)?
    };
    let container = Container::open(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let facts = VolumeFacts::of(&container);
    let container = Arc::new(placed(container, &facts, wish.exaggeration));
    let facts = VolumeFacts::of(&container);
    let overview = Overview::read(&container).ok().flatten();
    let scene = wish.scene.complete(&facts, overview.as_ref());
    let is_camera_asked = wish.scene.camera.is_some();
    let Open { path: source, exaggeration, .. } = wish;
    Ok(Arc::new(Opened { number, source, path, container, facts, overview, exaggeration, scene, is_camera_asked }))
}

fn is_container(path: &Path) -> std::io::Result<bool> {
    supervol_format::byte_source::check_is_file(path)?;
    let mut start = Vec::new();
    File::open(path)?.take(MAGIC.len() as u64).read_to_end(&mut start)?;
    Ok(start == MAGIC)
}

/// The container of a source file, in the cache folder: the one that is there, or a new one.
fn built(desk: &Desk, source: &Path, settings: &Settings) -> Result<PathBuf, String> {
    let output = container_of(source, desk.folders.cache.as_deref()).map_err(|e| e.to_string())?;
    if Container::open(&output).is_err() {
        build_into(desk, source, &output, settings).map_err(|e| advice(source, &e))?;
    }
    Ok(output)
}

fn build_into(desk: &Desk, source: &Path, output: &Path, settings: &Settings) -> Result<(), BuildError> {
    let options = BuildOptions { existing: Existing::Replace, ..BuildOptions::default() };
    let options = BuildOptions { threads: settings.threads.unwrap_or(options.threads), ..options };
    let open_options = OpenOptions { spool: SpoolFolder::at(folder_of(output)), ..OpenOptions::default() };
    let volume = open_source(source, &open_options)?;
    let origin = identify(source, volume.info().format)?;
    let last = std::sync::Mutex::new(None::<Instant>);
    build(volume.as_ref(), origin, output, &options, &|progress| {
        let mut last = super::lock(&last);
        if last.is_none_or(|at| at.elapsed() >= PROGRESS_INTERVAL) {
            *last = Some(Instant::now());
            desk.tell(|news| news.busy = Some(Busy::Building(source.into(), progress)));
        }
    })?;
    Ok(())
}

/// What is wrong with a source, and what to do.
fn advice(path: &Path, error: &BuildError) -> String {
    let path = path.display();
    format!(
        "{error}\nA file that does not say all about itself is built on the command line: supervol build {path} -o OUT.svol"
    )
}
