//! The command that draws the picture on the screen.

use std::fmt::Write as _;
use std::path::Path;

use supervol::Backend;
use supervol_scene::image::GREY_LEVELS;
use supervol_scene::scene::{Mode, Scene};
use xxhash_rust::xxh3::xxh3_64;

use crate::folders::{self, Folders};
use crate::worker::{Decorations, OpenVolume, Settings};

/// Most scene files kept for copied commands.
const SCENE_LIMIT: usize = 200;

/// Content of a scene file.
pub(crate) fn scene_text(scene: &Scene) -> String {
    serde_json::to_string_pretty(scene).expect("a scene has only text keys and finite numbers") + "\n"
}

/// The command that draws this picture. Its scene is written to a file in the cache folder, named by its checksum.
pub(crate) fn command_line(
    opened: &OpenVolume,
    scene: &Scene,
    settings: &Settings,
    folders: &Folders,
) -> Result<String, String> {
    let folder = folders
        .cache
        .as_ref()
        .ok_or("there is no cache folder for the scene of the command; save the scene instead")?;
    let text = scene_text(scene);
    let file = folder.join("scenes").join(format!("{:016x}.json", xxh3_64(text.as_bytes())));
    let write = || {
        std::fs::create_dir_all(folder.join("scenes"))?;
        std::fs::write(&file, &text)?;
        folders::keep_newest(&folder.join("scenes"), SCENE_LIMIT)
    };
    write().map_err(|e: std::io::Error| format!("{}: {e}", file.display()))?;
    let path = std::path::absolute(&opened.path).unwrap_or_else(|_| opened.path.clone());
    let mut line = format!("supervol render {} --scene {} -o picture.png", quoted(&path), quoted(&file));
    let default = Settings::default();
    // Writing to a string cannot fail.
    if settings.decorations == Decorations::On {
        line += " --decorate";
    }
    line += match settings.backend {
        Backend::Auto => "",
        Backend::Gpu if scene.mode != Some(Mode::Slice) => " --backend gpu",
        Backend::Cpu | Backend::Gpu | Backend::Reference => " --backend cpu",
    };
    if settings.max_error != default.max_error {
        let _ = write!(line, " --max-error {}/255", settings.max_error * GREY_LEVELS);
    }
    if settings.host_memory_bytes != default.host_memory_bytes {
        let _ = write!(line, " --host-memory {}MiB", settings.host_memory_bytes >> 20);
    }
    Ok(line)
}

/// A path quoted for a shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = text.chars().all(|c| c.is_ascii_alphanumeric() || "/._-+,:@%".contains(c));
    if is_plain && !text.is_empty() { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_quoted_for_shells() {
        assert_eq!(quoted(Path::new("/a/b-1.svol")), "/a/b-1.svol");
        assert_eq!(quoted(Path::new("/a b/it's")), r"'/a b/it'\''s'");
    }
}
