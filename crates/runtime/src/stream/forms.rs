//! Changes of the form of bricks in the host cache: what the streamer does when [`super::form`] decides.

use rayon::prelude::*;
use supervol_format::cast::whole;

use super::budget::BrickBytes;
use super::form::{FormPolicy, FrameNeeds, PackedPlan, Room};
use super::held::{BrickForm, HeldBrick, PackedBrick};
use crate::stream::cache::KeyMap;
use crate::stream::cache::host::{BRICK_OVERHEAD_BYTES, Standing};
use crate::stream::field::FieldBrick;
use crate::stream::streamer::{Fetched, Streamer};

/// Part of the cache, as a divisor, for bricks on their way while bricks are packed: they take plain bytes until they have
/// come.
const ON_THEIR_WAY_SHARE: u64 = 8;
/// Bricks packed on trial, to estimate the share of bytes that packing leaves.
const SAMPLE: usize = 8;

impl Streamer {
    /// Chooses the form of bricks. Bricks that are in the cache keep theirs.
    pub fn set_form(&mut self, choice: BrickForm) {
        self.form = FormPolicy::new(choice);
        self.divide_cache();
    }

    /// Division of the cache while bricks are packed; `None` if it is too small for packing.
    fn packed_plan(&self) -> Option<PackedPlan> {
        let threads = rayon::current_num_threads() as u64;
        PackedPlan::new(self.plan.cache_bytes, BrickBytes::of(&self.container).decoded, threads)
    }

    /// Gives the cache and the store of unpacked bricks their bytes. Nothing is being loaded afterwards.
    pub(super) fn divide_cache(&mut self) {
        self.cancel_all_but(KeyMap::default());
        while !self.is_idle() {
            self.receive_some(None, &mut Fetched::default());
        }
        let packed = self.packed_plan().filter(|_| self.form.is_packed());
        if packed.is_none() {
            self.form.stay_plain();
        }
        let [taken, store] = packed.map_or([0; 2], |plan| [plan.taken_bytes, plan.store_bytes]);
        let dropped = self.cache.set_budget(self.plan.cache_bytes - taken, |key| self.kept.contains_key(&key));
        for key in dropped {
            self.states.evict(key);
            self.kept.remove(&key);
        }
        self.unpacked.set_limit(store);
    }

    /// Decides the form for the coming frame by what the last one needed.
    pub(super) fn choose_form(&mut self) {
        let repeated = self.states.counters().repeated_page_ins;
        let needs = FrameNeeds {
            working_set_bytes: std::mem::take(&mut self.working_set_bytes),
            repeated_page_ins: repeated - self.repeated_before,
        };
        self.repeated_before = repeated;
        let Some(packed) = self.packed_plan() else { return };
        let plain_bytes = self.plan.cache_bytes;
        let room = Room { plain_bytes, packed_bytes: plain_bytes - packed.taken_bytes };
        let packed_bytes = || self.packed_bytes_of(needs.working_set_bytes);
        let mut form = self.form;
        let has_changed = form.after_frame(needs, room, packed_bytes);
        self.form = form;
        if !has_changed {
            return;
        }
        self.divide_cache();
        if !self.form.is_packed() {
            self.unpack_drawn();
        }
    }

    /// Estimate of the packed bytes of bricks with this many plain bytes, by some bricks of the cache.
    fn packed_bytes_of(&self, plain_bytes: u64) -> u64 {
        let mut keys: Vec<FieldBrick> = self.cache.keys().collect();
        keys.sort_unstable();
        let sample: Vec<&HeldBrick> =
            keys.iter().step_by(keys.len().div_ceil(SAMPLE).max(1)).filter_map(|&key| self.cache.get(key)).collect();
        let both_forms = |held: &&HeldBrick| match held {
            HeldBrick::Packed(packed) => [packed.bytes(), packed.plain_bytes()],
            HeldBrick::Plain(brick) => {
                let plain = brick.bytes();
                [PackedBrick::new(brick).map_or(plain, |packed| packed.bytes()), plain]
            }
        };
        let sums = sample.par_iter().map(both_forms).reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        whole::<u64>(plain_bytes as f64 * (sums[0] as f64 / sums[1].max(1) as f64))
    }

    /// Makes the bricks of the last frame plain again, as far as there is room.
    fn unpack_drawn(&mut self) {
        let stays = |key: &FieldBrick| self.drawn.contains_key(key) || self.kept.contains_key(key);
        let is_packed = |key: &FieldBrick| matches!(self.cache.get(*key), Some(HeldBrick::Packed(_)));
        let mut packed: Vec<FieldBrick> = self.cache.keys().filter(|key| stays(key) && is_packed(key)).collect();
        packed.sort_unstable();
        let mut victims = self.cache.victims(|key, _| if stays(&key) { Standing::Kept } else { Standing::Free });
        for keys in packed.chunks(rayon::current_num_threads()) {
            let more: u64 = keys.iter().map(|&key| self.bytes_of(key)).sum();
            let Ok(dropped) = self.cache.make_room(more, &mut victims) else { return };
            dropped.into_iter().for_each(|key| self.states.evict(key));
            let unpack = |&key: &FieldBrick| match self.cache.get(key) {
                Some(HeldBrick::Packed(packed)) => Some((key, packed.unpacked(None), packed.plain_bytes())),
                _ => None,
            };
            let plain: Vec<_> = keys.par_iter().filter_map(unpack).collect();
            for (key, brick, bytes) in plain {
                self.cache.replace(key, HeldBrick::Plain(brick), bytes + BRICK_OVERHEAD_BYTES);
            }
        }
    }

    /// How many of the next `count` due bricks may be on their way: while bricks are packed, only a part of the cache is
    /// made free for their plain bytes.
    pub(super) fn with_room_for_plain(&self, count: usize) -> usize {
        if !self.form.is_packed() {
            return count;
        }
        let mut bytes = self.cache.reserved_bytes();
        let fits = |load: &&super::streamer::Load| {
            bytes += load.bytes;
            bytes <= self.cache.budget_bytes() / ON_THEIR_WAY_SHARE
        };
        self.due.iter().take(count).take_while(fits).count()
    }
}
