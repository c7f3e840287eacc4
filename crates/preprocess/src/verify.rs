//! Checking a whole container: every rule of the format, brick by brick and level by level.
//!
//! 1. Header, footer, sections and manifest agree (opening the container checks that).
//! 2. The records tile the file: nothing overlaps, nothing is unreachable.
//! 3. Each brick keeps [`check_brick`]'s rules: checksum, flags, exact ranges, macro cells, range beneath.
//! 4. Aprons repeat the neighbours' voxels (and beyond the grid the nearest ones).
//! 5. Coarser voxels are the averages of the finer level's.
//! 6. Each error bound is the largest of its children's plus this level's own greatest difference, or what the value
//!    ranges allow where that is less ([`brick_error`]): not less, not more.
//!
//! Memory: a few bricks per thread, decoded bricks of two levels up to `memory_bytes`, 16 bytes per brick for rule 2.

use std::path::Path;
use std::sync::Mutex;

use rayon::prelude::*;
use supervol_format::container::validate::{check_brick, check_coverage};
use supervol_format::{BrickKey, Container, Lod, ValueRange};

use crate::bricker::cut_brick;
use crate::downsample::{VoxelBlock, downsample, finer_box};
use crate::error::BuildError;
use crate::error_bound::{brick_error, step_error};
use crate::level_reader::LevelReader;

/// Voxels around a core that a brick stores.
const APRON: u64 = supervol_format::brick::APRON as u64;
/// Bricks checked between two calls of the progress callback.
const BATCH: usize = 256;

/// Checks all rules; the error names the first broken one in entry order of a batch.
///
/// `on_progress` hears of bricks done and bricks in all.
///
/// # Errors
/// The first broken rule, or a failure to read.
pub fn verify(path: &Path, memory_bytes: u64, on_progress: &dyn Fn(u64, u64)) -> Result<Container, BuildError> {
    let wrong = |e| BuildError::container(path, e);
    let container = Container::open(path).map_err(wrong)?;
    check_coverage(&container).map_err(wrong)?;
    let total = container.pyramid().brick_count();
    let mut done = 0;
    for lod in 0..container.pyramid().levels().len() {
        let lod = Lod(lod as u8);
        let budget = (memory_bytes / 4) as usize;
        let own = LevelReader::new(&container, lod, budget);
        let finer = (lod > Lod::FINEST).then(|| LevelReader::new(&container, Lod(lod.0 - 1), budget));
        let mut keys = container.pyramid().keys_of(lod).peekable();
        while keys.peek().is_some() {
            let batch: Vec<BrickKey> = keys.by_ref().take(BATCH).collect();
            let first_broken = Mutex::new(None::<(usize, BuildError)>);
            batch.par_iter().enumerate().for_each(|(i, &key)| {
                if let Err(error) = check(path, &container, key, &own, finer.as_ref()) {
                    let mut first = first_broken.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                    if first.as_ref().is_none_or(|(j, _)| i < *j) {
                        *first = Some((i, error));
                    }
                }
            });
            if let Some((_, error)) = first_broken.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
                return Err(error);
            }
            done += batch.len() as u64;
            on_progress(done, total);
        }
    }
    Ok(container)
}

fn check(
    path: &Path,
    container: &Container,
    key: BrickKey,
    own: &LevelReader<'_>,
    finer: Option<&LevelReader<'_>>,
) -> Result<(), BuildError> {
    let wrong = |e| BuildError::container(path, e);
    let broken = |rule: &str, expected: String, found: String| BuildError::Broken {
        path: path.into(),
        rule: format!("{key}: {rule}"),
        expected,
        found,
    };
    let (entry, stored) = check_brick(container, key).map_err(wrong)?;
    let descriptor = container.descriptor();
    let (voxel_type, absence) = (descriptor.voxel_type, descriptor.absence);
    let size = voxel_type.bytes();
    let pyramid = container.pyramid();
    let level = pyramid.level_at(key.lod());
    let core = pyramid.core_box(key);

    // Rule 4: what the neighbours own is what this brick's apron holds.
    let around = core.grown(APRON, level.dims);
    let mut voxels = vec![0; around.voxels() * size];
    own.read_box(around, &mut voxels).map_err(wrong)?;
    let block = VoxelBlock { voxels: around, bytes: &voxels };
    let expected = cut_brick(pyramid, key, size, block);
    if let Some(at) = expected.iter().zip(&stored).position(|(e, s)| e != s) {
        return Err(broken("apron", format!("{} at byte {at}", expected[at]), stored[at].to_string()));
    }
    let Some(finer) = finer else { return Ok(()) };

    // Rule 5: averages.
    let finer_dims = pyramid.level_at(Lod(key.lod().0 - 1)).dims;
    let fine_box = finer_box(around, level.factors, finer_dims);
    let mut fine = vec![0; fine_box.voxels() * size];
    finer.read_box(fine_box, &mut fine).map_err(wrong)?;
    let fine = VoxelBlock { voxels: fine_box, bytes: &fine };
    let mut averages = vec![0; around.voxels() * size];
    downsample(voxel_type, absence, level.factors, fine, around, &mut averages);
    if let Some(at) = averages.iter().zip(&voxels).position(|(a, v)| a != v) {
        return Err(broken(
            "average of the finer level",
            format!("{} at byte {at}", averages[at]),
            voxels[at].to_string(),
        ));
    }

    // Rule 6: the error bound.
    let (mut beneath, mut children_error) = (ValueRange::EMPTY, 0.0f64);
    for child in pyramid.children(key) {
        let child = container.entry(child).map_err(wrong)?;
        beneath = beneath.union(child.range_beneath);
        children_error = children_error.max(child.error);
    }
    let step = step_error(voxel_type, absence, level.factors, fine, block, core);
    let expected = brick_error(children_error, step, entry.range, beneath);
    if entry.error != expected {
        return Err(broken("error bound", expected.to_string(), entry.error.to_string()));
    }
    Ok(())
}
