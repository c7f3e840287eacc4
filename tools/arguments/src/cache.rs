//! Volume files where containers are asked for: built into the cache folder first.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use clap::Args;
use supervol_preprocess::BuildOptions;
use supervol_preprocess::kept::{CACHE_LIMIT_BYTES, Cache, Reading, Told, is_container};

use crate::failure::Failure;
use crate::progress::{Reporter, announce};
use crate::quantity::{self, show_bytes};
use crate::source::refuse_for_container;

/// Where containers of volume files are kept.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Volume files instead of containers")]
pub struct CacheArguments {
    /// Folder in which containers of volume files are kept; by default $XDG_CACHE_HOME/supervol or ~/.cache/supervol (macOS:
    /// ~/Library/Caches/supervol, Windows: %LOCALAPPDATA%\\supervol\\cache)
    #[arg(long, value_name = "DIR")]
    pub cache: Option<PathBuf>,
    /// Most bytes of containers that are kept there: those that were used longest ago are removed, never the one that is shown
    /// [default: 32GiB]
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    cache_limit: Option<u64>,
}

impl CacheArguments {
    /// See `--cache-limit`.
    pub fn limit_bytes(&self) -> u64 {
        self.cache_limit.unwrap_or(CACHE_LIMIT_BYTES)
    }

    /// The container that is meant: the file itself where it is one, else what is kept of it, or is built now.
    pub fn container_of(
        &self,
        input: &Path,
        reading: &Reading,
        threads: Option<usize>,
        memory_bytes: u64,
    ) -> Result<PathBuf, Failure> {
        if is_container(input) {
            refuse_for_container(reading, input)?;
            return Ok(input.into());
        }
        let cache = Cache::below(self.cache.as_deref(), self.limit_bytes())?;
        let options = BuildOptions::default();
        let options = BuildOptions { threads: threads.unwrap_or(options.threads), memory_bytes, ..options };
        let bar = Mutex::new(None::<Reporter>);
        let path = cache.container_of(input, reading, &options, &|told| {
            let mut bar = bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            match told {
                Told::Building(path) => {
                    announce(&format!(
                        "{} is no container: one is built first, and kept as {} (at most {} there)",
                        input.display(),
                        path.display(),
                        show_bytes(self.limit_bytes())
                    ));
                    *bar = Some(Reporter::over_bytes(false));
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
