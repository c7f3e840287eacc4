//! Form of the bricks that come into the host cache: plain while everything fits, packed when it does not.
//!
//! The *working set* of a frame are the bricks that its rays used. The cache is too small for it if their plain bytes
//! exceed the cache, and if bricks had to be read again. If it fits when it is packed, the next frame packs the bricks that
//! come. Otherwise each frame would read, and pack, all of it: the least recently used brick is the next that rays want.
//! Packing does not help a single picture: it reads each brick once, whatever the cache's size.
//!
//! Bricks are plain again after some frames in a row whose working sets fill at most a part of the cache, and at once when
//! the working set does not fit though packed.

use crate::stream::held::BrickForm;

/// Part of the cache for unpacked bricks while bricks are packed, as a divisor.
const STORE_SHARE: u64 = 8;
/// Most that they may take where bricks are large, as a divisor: otherwise bricks stay plain.
const STORE_LIMIT_SHARE: u64 = 4;
/// Bricks beside the store for each thread: one that left the store while it is in use, and one being packed.
const IN_USE: u64 = 2;
/// Least number of bricks in the store.
const LEAST_STORED: u64 = 2;
/// Frames in a row that must have room before bricks are plain again.
const CALM_FRAMES: u32 = 8;
/// Part of the cache that such a frame fills at most: three quarters.
const CALM_SHARE: [u64; 2] = [3, 4];
/// Part of the cache that a working set must fit into when it is packed: seven eighths, because its size is estimated.
const FITS_SHARE: [u64; 2] = [7, 8];

/// Bytes of the cache in either form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// While bricks are plain.
    pub plain_bytes: u64,
    /// While bricks are packed: less the store of unpacked ones.
    pub packed_bytes: u64,
}

/// Needs of one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameNeeds {
    /// Plain bytes of the bricks that rays used.
    pub working_set_bytes: u64,
    /// Bricks that came though they had been in the cache before.
    pub repeated_page_ins: u64,
}

/// Division of the cache's bytes while bricks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PackedPlan {
    /// Bytes taken off the cache: the store of unpacked bricks, and those in use beside it.
    pub taken_bytes: u64,
    /// Bytes of the store.
    pub store_bytes: u64,
}

impl PackedPlan {
    /// The division of a cache; `None` if packing would not pay: it is too small for such bricks and threads.
    #[must_use]
    pub fn new(cache_bytes: u64, brick_bytes: u64, threads: u64) -> Option<Self> {
        let in_use = IN_USE * threads * brick_bytes;
        let taken_bytes = (cache_bytes / STORE_SHARE).max(in_use + LEAST_STORED * brick_bytes);
        let pays = taken_bytes <= cache_bytes / STORE_LIMIT_SHARE;
        pays.then_some(Self { taken_bytes, store_bytes: taken_bytes - in_use })
    }
}

/// The form of coming bricks, frame after frame.
#[derive(Debug, Clone, Copy, Default)]
pub struct FormPolicy {
    choice: BrickForm,
    is_packed: bool,
    calm_frames: u32,
}

impl FormPolicy {
    /// A policy before the first frame.
    #[must_use]
    pub fn new(choice: BrickForm) -> Self {
        Self { choice, is_packed: choice == BrickForm::Packed, calm_frames: 0 }
    }

    /// Whether bricks that come are packed.
    #[must_use]
    pub fn is_packed(&self) -> bool {
        self.is_packed
    }

    /// Packing does not pay: bricks stay plain, until a frame asks for packing again.
    pub(super) fn stay_plain(&mut self) {
        self.is_packed = false;
    }

    /// Decides the form for the next frame; returns whether it changed. `packed_bytes` estimates the packed bytes of the
    /// working set; it is asked only where it matters.
    pub fn after_frame(&mut self, needs: FrameNeeds, room: Room, packed_bytes: impl FnOnce() -> u64) -> bool {
        if self.choice != BrickForm::ByBudget {
            return false;
        }
        let before = self.is_packed;
        if self.is_packed {
            let is_calm = needs.working_set_bytes <= part_of(room.plain_bytes, CALM_SHARE);
            self.calm_frames = if is_calm { self.calm_frames + 1 } else { 0 };
            let helps = needs.repeated_page_ins == 0 || packed_bytes() <= room.packed_bytes;
            self.is_packed = helps && self.calm_frames < CALM_FRAMES;
        } else {
            self.calm_frames = 0;
            self.is_packed = needs.working_set_bytes > room.plain_bytes
                && needs.repeated_page_ins > 0
                && packed_bytes() <= part_of(room.packed_bytes, FITS_SHARE);
        }
        self.is_packed != before
    }
}

fn part_of(bytes: u64, [numerator, denominator]: [u64; 2]) -> u64 {
    bytes / denominator * numerator
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(working_set_bytes: u64, repeated_page_ins: u64) -> FrameNeeds {
        FrameNeeds { working_set_bytes, repeated_page_ins }
    }

    const ROOM: Room = Room { plain_bytes: 100, packed_bytes: 80 };

    #[test]
    fn bricks_are_packed_once_a_frame_reads_again_what_does_not_fit() {
        let mut policy = FormPolicy::new(BrickForm::ByBudget);
        assert!(!policy.after_frame(needs(100, 5), ROOM, || 10), "it fits: the bricks came back from another view");
        assert!(!policy.after_frame(needs(300, 0), ROOM, || 10), "a single picture reads each brick once");
        assert!(!policy.after_frame(needs(300, 9), ROOM, || 71), "packed, it does not fit either");
        assert!(!policy.is_packed());
        assert!(policy.after_frame(needs(101, 1), ROOM, || 70) && policy.is_packed());
    }

    #[test]
    fn bricks_are_plain_again_after_eight_calm_frames_in_a_row() {
        let mut policy = FormPolicy::new(BrickForm::ByBudget);
        policy.after_frame(needs(300, 9), ROOM, || 10);
        for frame in 0..7 {
            assert!(!policy.after_frame(needs(75, 0), ROOM, || 10), "{frame}");
        }
        assert!(!policy.after_frame(needs(76, 0), ROOM, || 10), "this one is not calm");
        for frame in 0..7 {
            assert!(!policy.after_frame(needs(75, 0), ROOM, || 10) && policy.is_packed(), "{frame}");
        }
        assert!(policy.after_frame(needs(75, 0), ROOM, || 10) && !policy.is_packed());
    }

    #[test]
    fn bricks_are_plain_again_at_once_when_they_do_not_fit_though_packed() {
        let mut policy = FormPolicy::new(BrickForm::ByBudget);
        policy.after_frame(needs(300, 9), ROOM, || 70);
        assert!(!policy.after_frame(needs(300, 9), ROOM, || 80), "it fits, if nothing else is kept");
        assert!(!policy.after_frame(needs(400, 0), ROOM, || 90), "nothing was read again");
        assert!(policy.after_frame(needs(400, 1), ROOM, || 81) && !policy.is_packed());
    }

    #[test]
    fn a_chosen_form_stays() {
        for (choice, is_packed) in [(BrickForm::Plain, false), (BrickForm::Packed, true)] {
            let mut policy = FormPolicy::new(choice);
            for frame in 0..20 {
                assert!(!policy.after_frame(needs(frame * 20, frame % 2), ROOM, || 10));
                assert_eq!(policy.is_packed(), is_packed);
            }
        }
    }

    #[test]
    fn the_store_takes_an_eighth_or_what_threads_need_and_never_more_than_a_quarter() {
        let plan = |cache, brick, threads| PackedPlan::new(cache, brick, threads);
        assert_eq!(plan(8000, 10, 2), Some(PackedPlan { taken_bytes: 1000, store_bytes: 960 }));
        assert_eq!(plan(8000, 300, 2), Some(PackedPlan { taken_bytes: 1800, store_bytes: 600 }));
        assert_eq!(plan(8000, 400, 2), None);
        assert_eq!(plan(8000, 300, 4), None);
    }
}
