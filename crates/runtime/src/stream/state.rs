//! The state of each brick of each field, and the only code that changes it.
//!
//! ```text
//!   Unknown --> Nothing | Uniform | TooCoarse     decided from the TOC entry, without reading the brick
//!   TooCoarse --> Nothing | Uniform           the same, where the brick stands in for a child
//!   Unknown, TooCoarse --> Queued --> Reading --> Decoding --> InHost --> Evicted --> Queued ...
//!   Unknown, TooCoarse, Evicted, Reading, Decoding --> Failed      TOC entry, read, checksum, codec
//!   Queued, Reading --> Unknown | Evicted     cancelled: no ray wants it any more
//!   Failed --> Unknown                        may be tried again, in a later frame
//!   Evicted --> Nothing | Uniform | TooCoarse     under a new transfer function
//!   Nothing, Uniform, TooCoarse, Evicted --> Unknown     forgotten, or to be classified anew
//! ```
//!
//! Every brick is `Unknown` until a ray wants it. A transition that the table [`ALLOWED`] does not list is a bug and
//! panics with both states. Transitions are counted by kind, bricks by state and level. Memory: at most
//! [`RECORD_BYTES`] for each brick that is not `Unknown`. [`StateTable::forget`] keeps their number below a limit: it
//! drops states that can be determined again.

use serde::{Deserialize, Serialize};
use supervol_format::Lod;

use crate::stream::cache::KeyMap;
use crate::stream::counters::StreamCounters;
use crate::stream::field::FieldBrick;

/// Bytes of one remembered brick in the table at its lowest load, right after it has grown.
pub const RECORD_BYTES: u64 = 3 * (size_of::<(FieldBrick, BrickRecord)>() as u64 + 1);
/// Most failures kept with their reasons; all are counted.
pub const FAILURES_KEPT: usize = 16;
/// Most attempts at one brick over all frames.
pub const ATTEMPT_LIMIT: u32 = 8;

/// Reason why a brick draws nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emptiness {
    /// It holds no data.
    Absent,
    /// Its values are invisible under the current transfer function or iso values.
    Invisible,
}

/// State of one brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BrickState {
    /// No ray has wanted it yet.
    Unknown,
    /// Nothing in it can be seen.
    Nothing(Emptiness),
    /// One render value everywhere.
    Uniform(f32),
    /// It would change the picture too much: rays continue in its children. It is read only to stand in for a child.
    TooCoarse,
    /// Wanted; reading has not begun.
    Queued,
    /// Its record is being read.
    Reading,
    /// Its record is being decoded.
    Decoding,
    /// In the host cache.
    InHost,
    /// Dropped from the host cache.
    Evicted,
    /// Could not be read or decoded: its parent is drawn.
    Failed {
        /// Attempts so far, at least 1.
        attempts: u32,
        /// Frames to begin before the next attempt.
        frames_to_wait: u32,
    },
}

/// A state without its details.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "named as the states of BrickState")]
pub enum StateKind {
    Unknown,
    Nothing,
    Uniform,
    TooCoarse,
    Queued,
    Reading,
    Decoding,
    InHost,
    Evicted,
    Failed,
}

/// Number of [`StateKind`]s.
pub const KINDS: usize = 10;

use StateKind as K;

/// The allowed transitions, (from, to). All others are bugs.
pub const ALLOWED: [(StateKind, StateKind); 29] = [
    (K::Unknown, K::Nothing),
    (K::Unknown, K::Uniform),
    (K::Unknown, K::TooCoarse),
    (K::Unknown, K::Queued),
    (K::Unknown, K::Failed),
    (K::Queued, K::Reading),
    (K::Queued, K::Unknown),
    (K::Queued, K::Evicted),
    (K::Reading, K::Decoding),
    (K::Reading, K::Failed),
    (K::Reading, K::Unknown),
    (K::Reading, K::Evicted),
    (K::Decoding, K::InHost),
    (K::Decoding, K::Failed),
    (K::InHost, K::Evicted),
    (K::Evicted, K::Queued),
    (K::Evicted, K::Nothing),
    (K::Evicted, K::Uniform),
    (K::Evicted, K::TooCoarse),
    (K::Evicted, K::Failed),
    (K::Evicted, K::Unknown),
    (K::Failed, K::Unknown),
    (K::Nothing, K::Unknown),
    (K::Uniform, K::Unknown),
    (K::TooCoarse, K::Nothing),
    (K::TooCoarse, K::Uniform),
    (K::TooCoarse, K::Queued),
    (K::TooCoarse, K::Failed),
    (K::TooCoarse, K::Unknown),
];

impl StateKind {
    /// Every kind, in declaration order.
    pub const ALL: [Self; KINDS] = [
        K::Unknown,
        K::Nothing,
        K::Uniform,
        K::TooCoarse,
        K::Queued,
        K::Reading,
        K::Decoding,
        K::InHost,
        K::Evicted,
        K::Failed,
    ];

    /// Name used in statistics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            K::Unknown => "unknown",
            K::Nothing => "nothing",
            K::Uniform => "uniform",
            K::TooCoarse => "too_coarse",
            K::Queued => "queued",
            K::Reading => "reading",
            K::Decoding => "decoding",
            K::InHost => "in_host",
            K::Evicted => "evicted",
            K::Failed => "failed",
        }
    }
}

impl BrickState {
    /// The state without its details.
    #[must_use]
    pub fn kind(self) -> StateKind {
        match self {
            Self::Unknown => K::Unknown,
            Self::Nothing(_) => K::Nothing,
            Self::Uniform(_) => K::Uniform,
            Self::TooCoarse => K::TooCoarse,
            Self::Queued => K::Queued,
            Self::Reading => K::Reading,
            Self::Decoding => K::Decoding,
            Self::InHost => K::InHost,
            Self::Evicted => K::Evicted,
            Self::Failed { .. } => K::Failed,
        }
    }
}

/// Record of one brick.
#[derive(Debug, Clone, Copy)]
struct BrickRecord {
    state: BrickState,
    /// Times the brick came into the host cache.
    page_ins: u32,
}

/// Description of one failed brick, for users.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// The brick, in words.
    pub brick: String,
    /// The error, with place and values.
    pub reason: String,
}

/// States of all bricks of all fields. Counts by level are sums over the fields.
#[derive(Debug)]
pub struct StateTable {
    records: KeyMap<BrickRecord>,
    /// Bricks by level and state; those in `Unknown` are not counted.
    counts: Vec<[u64; KINDS]>,
    /// Transitions, `[from][to]`.
    transitions: [[u64; KINDS]; KINDS],
    page_ins: Vec<u64>,
    counters: StreamCounters,
    failures: Vec<Failure>,
}

impl StateTable {
    /// A table for this many levels; every brick is `Unknown`.
    #[must_use]
    pub fn new(levels: usize) -> Self {
        Self {
            records: KeyMap::default(),
            counts: vec![[0; KINDS]; levels],
            transitions: [[0; KINDS]; KINDS],
            page_ins: vec![0; levels],
            counters: StreamCounters::default(),
            failures: Vec::new(),
        }
    }

    /// State of a brick.
    #[inline]
    #[must_use]
    pub fn state(&self, key: FieldBrick) -> BrickState {
        self.records.get(&key).map_or(BrickState::Unknown, |r| r.state)
    }

    /// Sets the state: by its TOC entry, nothing of the brick can be seen.
    pub fn nothing(&mut self, key: FieldBrick, why: Emptiness) {
        self.enter(key, BrickState::Nothing(why));
    }

    /// Sets the state: by its TOC entry, the brick has one render value everywhere.
    pub fn uniform(&mut self, key: FieldBrick, value: f32) {
        self.enter(key, BrickState::Uniform(value));
    }

    /// Sets the state: by the level rules, the brick would change the picture too much.
    pub fn too_coarse(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::TooCoarse);
    }

    /// Sets the state: the brick is wanted and must be read.
    pub fn queue(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::Queued);
    }

    /// Cancels a brick: no ray wants it any more, and no thread has begun to read it.
    pub fn cancel(&mut self, key: FieldBrick) {
        let was_in_host = self.records.get(&key).is_some_and(|r| r.page_ins > 0);
        self.enter(key, if was_in_host { BrickState::Evicted } else { BrickState::Unknown });
    }

    /// Sets the state: the brick's record is being read.
    pub fn start_reading(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::Reading);
    }

    /// Sets the state: the brick's record was read and is being decoded.
    pub fn start_decoding(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::Decoding);
    }

    /// Sets the state: the brick is in the host cache.
    pub fn in_host(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::InHost);
        self.page_ins[level(key)] += 1;
        let record = self.records.get_mut(&key).expect("a brick in the host cache has a record");
        record.page_ins += 1;
        self.counters.repeated_page_ins += u64::from(record.page_ins > 1);
    }

    /// Sets the state: the host cache dropped the brick.
    pub fn evict(&mut self, key: FieldBrick) {
        self.enter(key, BrickState::Evicted);
    }

    /// Sets the state: the brick cannot be used in this frame. The wait until the next attempt doubles with each
    /// failure.
    pub fn fail(&mut self, key: FieldBrick, earlier_attempts: u32, reason: String) {
        let attempts = earlier_attempts + 1;
        self.enter(key, BrickState::Failed { attempts, frames_to_wait: 1 << attempts.min(16) });
        if self.failures.len() < FAILURES_KEPT {
            self.failures.push(Failure { brick: key.to_string(), reason });
        }
    }

    /// Begins a frame: shortens the waits of failed bricks. Returns the bricks that may be tried again, which become
    /// `Unknown`, with their attempts so far.
    pub fn begin_frame(&mut self) -> Vec<(FieldBrick, u32)> {
        let mut retry = Vec::new();
        for (&key, record) in &mut self.records {
            if let BrickState::Failed { attempts, frames_to_wait } = &mut record.state {
                *frames_to_wait = frames_to_wait.saturating_sub(1);
                if *frames_to_wait == 0 && *attempts < ATTEMPT_LIMIT {
                    retry.push((key, *attempts));
                }
            }
        }
        retry.sort_unstable();
        for &(key, _) in &retry {
            self.enter(key, BrickState::Unknown);
        }
        retry
    }

    /// Resets all decided bricks. Called when the transfer function, the mode, the iso values or the camera changed:
    /// invisible or too coarse bricks may be needed now, and the reverse.
    pub fn reclassify(&mut self) {
        let decided = |r: &BrickRecord| matches!(r.state.kind(), K::Nothing | K::Uniform | K::TooCoarse);
        let keys: Vec<FieldBrick> = self.records.iter().filter(|(_, r)| decided(r)).map(|(&k, _)| k).collect();
        for key in keys {
            self.enter(key, BrickState::Unknown);
        }
    }

    /// Bricks that are not `Unknown`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether every brick is `Unknown`.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Drops states that can be determined again while the table holds more than `limit` bricks: evicted bricks and
    /// those decided from their TOC entry. Returns the number dropped. A page-in after this does not count as repeated.
    pub fn forget(&mut self, limit: usize) -> u64 {
        if self.records.len() <= limit {
            return 0;
        }
        let cheap = |r: &BrickRecord| matches!(r.state.kind(), K::Nothing | K::Uniform | K::TooCoarse | K::Evicted);
        let keys: Vec<FieldBrick> = self.records.iter().filter(|(_, r)| cheap(r)).map(|(&k, _)| k).collect();
        for &key in &keys {
            self.enter(key, BrickState::Unknown);
        }
        self.counters.states_forgotten += keys.len() as u64;
        keys.len() as u64
    }

    fn enter(&mut self, key: FieldBrick, to: BrickState) {
        let record = self.records.entry(key).or_insert(BrickRecord { state: BrickState::Unknown, page_ins: 0 });
        let (from, to_kind) = (record.state.kind(), to.kind());
        assert!(is_allowed(from, to_kind), "{key} must not go from {from:?} to {to_kind:?}");
        record.state = to;
        self.transitions[from as usize][to_kind as usize] += 1;
        let counts = &mut self.counts[level(key)];
        if from != K::Unknown {
            counts[from as usize] -= 1;
        }
        if to_kind == K::Unknown {
            self.records.remove(&key);
        } else {
            counts[to_kind as usize] += 1;
        }
    }

    /// Number of bricks of a level in a state; `Unknown` ones are not counted here.
    #[must_use]
    pub fn count(&self, lod: Lod, kind: StateKind) -> u64 {
        self.counts[lod.0 as usize][kind as usize]
    }

    /// Number of bricks of all levels in a state; `Unknown` ones are not counted here.
    #[must_use]
    pub fn total(&self, kind: StateKind) -> u64 {
        self.counts.iter().map(|c| c[kind as usize]).sum()
    }

    /// Number of transitions from one state to another.
    #[must_use]
    pub fn transitions(&self, from: StateKind, to: StateKind) -> u64 {
        self.transitions[from as usize][to as usize]
    }

    /// Number of page-ins into the host cache of bricks of a level.
    #[must_use]
    pub fn page_ins(&self, lod: Lod) -> u64 {
        self.page_ins[lod.0 as usize]
    }

    /// Counters: repeated page-ins and forgotten states.
    #[must_use]
    pub fn counters(&self) -> &StreamCounters {
        &self.counters
    }

    /// The first failures, at most [`FAILURES_KEPT`].
    #[must_use]
    pub fn failures(&self) -> &[Failure] {
        &self.failures
    }
}

/// Whether a brick may go from one state to another.
#[must_use]
pub fn is_allowed(from: StateKind, to: StateKind) -> bool {
    ALLOWED.contains(&(from, to))
}

fn level(key: FieldBrick) -> usize {
    key.lod().0 as usize
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey};

    use super::*;
    use crate::stream::field::Field;

    fn key(x: u32) -> FieldBrick {
        Field::FIRST.brick(BrickKey::new(Lod((x % 2) as u8), BrickIndex([x, 0, 0])))
    }

    /// A table with `key(0)` in the state, reached by allowed transitions.
    fn table_in(kind: StateKind) -> StateTable {
        let mut t = StateTable::new(2);
        let k = key(0);
        let to_host = |t: &mut StateTable| {
            t.queue(k);
            t.start_reading(k);
            t.start_decoding(k);
            t.in_host(k);
        };
        match kind {
            K::Unknown => {}
            K::Nothing => t.nothing(k, Emptiness::Absent),
            K::Uniform => t.uniform(k, 1.0),
            K::TooCoarse => t.too_coarse(k),
            K::Queued => t.queue(k),
            K::Reading => {
                t.queue(k);
                t.start_reading(k);
            }
            K::Decoding => {
                t.queue(k);
                t.start_reading(k);
                t.start_decoding(k);
            }
            K::InHost => to_host(&mut t),
            K::Evicted => {
                to_host(&mut t);
                t.evict(k);
            }
            K::Failed => t.fail(k, 0, "broken".into()),
        }
        assert_eq!(t.state(k).kind(), kind);
        t
    }

    #[test]
    fn every_allowed_transition_happens_and_is_counted_and_every_other_panics() {
        let details = |kind| match kind {
            K::Unknown => BrickState::Unknown,
            K::Nothing => BrickState::Nothing(Emptiness::Invisible),
            K::Uniform => BrickState::Uniform(0.5),
            K::TooCoarse => BrickState::TooCoarse,
            K::Queued => BrickState::Queued,
            K::Reading => BrickState::Reading,
            K::Decoding => BrickState::Decoding,
            K::InHost => BrickState::InHost,
            K::Evicted => BrickState::Evicted,
            K::Failed => BrickState::Failed { attempts: 1, frames_to_wait: 2 },
        };
        for from in StateKind::ALL {
            for to in StateKind::ALL {
                let mut t = table_in(from);
                let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    t.enter(key(0), details(to));
                    t
                }));
                assert_eq!(result.is_ok(), is_allowed(from, to), "{from:?} to {to:?}");
                if let Ok(t) = result {
                    assert!(t.transitions(from, to) >= 1);
                    let counted: u64 = StateKind::ALL.iter().map(|&k| t.total(k)).sum();
                    assert_eq!(counted, u64::from(to != K::Unknown), "{from:?} to {to:?}");
                    assert_eq!(t.len() as u64, counted);
                }
            }
        }
    }

    #[test]
    fn page_ins_and_repeats_are_counted_by_level() {
        let mut t = table_in(K::Evicted);
        t.queue(key(0));
        t.cancel(key(0));
        assert_eq!(t.state(key(0)), BrickState::Evicted, "a cancelled brick that was in host goes back to evicted");
        t.queue(key(0));
        t.start_reading(key(0));
        t.start_decoding(key(0));
        t.in_host(key(0));
        assert_eq!((t.page_ins(Lod(0)), t.page_ins(Lod(1)), t.counters().repeated_page_ins), (2, 0, 1));
        t.queue(key(2));
        t.cancel(key(2));
        assert_eq!(t.state(key(2)), BrickState::Unknown);
    }

    #[test]
    fn bricks_of_two_fields_at_one_place_have_states_of_their_own() {
        let mut t = table_in(K::InHost);
        let (a, b) = (key(0), Field(1).brick(key(0).brick));
        assert_eq!(t.state(b), BrickState::Unknown);
        t.queue(b);
        assert_eq!((t.state(a), t.state(b), t.len()), (BrickState::InHost, BrickState::Queued, 2));
        t.start_reading(b);
        t.start_decoding(b);
        t.in_host(b);
        // The second field's brick comes for the first time. Both bricks are counted at their level.
        assert_eq!((t.page_ins(Lod(0)), t.counters().repeated_page_ins), (2, 0));
        assert_eq!((t.count(Lod(0), K::InHost), t.total(K::InHost)), (2, 2));
        t.evict(a);
        assert_eq!((t.state(a), t.state(b)), (BrickState::Evicted, BrickState::InHost));
        // Both count towards the limit. The evicted one is dropped, the other stays.
        assert_eq!((t.forget(2), t.forget(1), t.len()), (0, 1, 1));
        assert_eq!((t.state(a), t.state(b)), (BrickState::Unknown, BrickState::InHost));
        t.fail(a, 0, "broken".into());
        t.evict(b);
        t.queue(b);
        t.start_reading(b);
        t.fail(b, 0, "broken, too".into());
        let failed: Vec<&str> = t.failures().iter().map(|failure| failure.brick.as_str()).collect();
        assert_eq!(failed, ["brick (0, 0, 0) of LOD 0", "brick (0, 0, 0) of LOD 0 of field 1"]);
    }

    #[test]
    fn failed_bricks_back_off_and_give_up() {
        let mut t = table_in(K::Failed);
        let mut waits = Vec::new();
        let mut waited = 0;
        while waits.len() < 20 && waited < 10_000 {
            waited += 1;
            for (k, attempts) in t.begin_frame() {
                assert_eq!(t.state(k), BrickState::Unknown);
                t.fail(k, attempts, "still broken".into());
                waits.push(waited);
                waited = 0;
            }
        }
        assert_eq!(waits, [2, 4, 8, 16, 32, 64, 128], "the wait doubles until the last attempt");
        assert!(matches!(t.state(key(0)), BrickState::Failed { attempts: ATTEMPT_LIMIT, .. }));
        assert_eq!(t.failures().len(), 8);
    }

    #[test]
    fn forgetting_and_reclassifying_keep_what_cannot_be_found_out_again() {
        let mut t = table_in(K::InHost);
        t.nothing(key(1), Emptiness::Invisible);
        t.uniform(key(2), 3.0);
        t.fail(key(3), 0, "broken".into());
        assert_eq!(t.forget(4), 0);
        t.reclassify();
        assert_eq!(t.len(), 2);
        t.nothing(key(1), Emptiness::Absent);
        assert_eq!((t.forget(1), t.counters().states_forgotten, t.len()), (1, 1, 2));
        assert_eq!(t.state(key(0)), BrickState::InHost);
        assert_eq!(t.state(key(3)).kind(), K::Failed);
    }

    #[test]
    fn failures_are_listed_up_to_the_limit_and_all_counted() {
        let mut t = StateTable::new(2);
        (0..40).for_each(|i| t.fail(key(2 * i), 0, format!("reason {i}")));
        assert_eq!((t.failures().len(), t.total(K::Failed)), (FAILURES_KEPT, 40));
        assert_eq!(t.failures()[1].reason, "reason 1");
    }
}
