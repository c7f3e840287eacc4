//! Cache folder: a command that needs a container builds one from a volume file, and keeps it here.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use clap::Args;
use supervol_preprocess::BuildOptions;
use supervol_preprocess::kept::{CACHE_LIMIT_BYTES, Cache, Reading, Told, is_container};

use crate::failure::Failure;
use crate::progress::{Reporter, announce};
use crate::quantity::{self, show_bytes};
use crate::source::refuse_for_container;
use crate::terminal::Format;

/// Options of the cache folder.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Volume files instead of containers")]
pub struct CacheArguments {
    /// Cache folder: keeps containers that were built from volume files [default: supervol in the cache folder of the
    /// user]
    ///
    /// The default is $XDG_CACHE_HOME/supervol or ~/.cache/supervol on Linux, ~/Library/Caches/supervol on macOS, and
    /// %LOCALAPPDATA%\\supervol\\cache on Windows.
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,
    /// Size limit of the cache folder, for example 100GiB [default: 32GiB]
    ///
    /// Above the limit, the least recently used containers are removed. The container in use always stays.
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    cache_limit: Option<u64>,
}

impl CacheArguments {
    /// Value of `--cache-limit`, bytes.
    pub fn limit_bytes(&self) -> u64 {
        self.cache_limit.unwrap_or(CACHE_LIMIT_BYTES)
    }

    /// Container of an input: the input itself if it is a container, else a kept one, else a new one.
    ///
    /// # Errors
    /// If the input is a container and `reading` has options, if the cache folder is unusable, or if the input cannot
    /// be built.
    pub fn container_of(
        &self,
        input: &Path,
        reading: &Reading,
        (threads, memory_bytes): (Option<usize>, u64),
        kind: Option<&str>,
    ) -> Result<PathBuf, Failure> {
        if is_container(input) {
            refuse_for_container(reading, input)?;
            return Ok(input.into());
        }
        let cache = Cache::below(self.cache.as_deref(), self.limit_bytes())?;
        let options = BuildOptions::default();
        let threads = threads.unwrap_or(options.threads);
        let options = BuildOptions { threads, memory_bytes, kind: kind.map(Into::into), ..options };
        let bar = Mutex::new(None::<Reporter>);
        let path = cache.container_of(input, reading, &options, &|told| {
            let mut bar = bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            match told {
                Told::Building(path) => {
                    announce(&format!(
                        "{}: building a container of this volume file; it is kept as {} (limit of the cache folder: {})",
                        input.display(),
                        path.display(),
                        show_bytes(self.limit_bytes())
                    ));
                    *bar = Some(Reporter::over_bytes(Format::Text));
                }
                Told::Preview(_) => {}
                Told::Progress(progress) => {
                    if let Some(bar) = &*bar {
                        bar.show(progress);
                    }
                }
            }
        });
        if let Some(bar) = bar.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
            bar.finish();
        }
        Ok(path?)
    }
}
