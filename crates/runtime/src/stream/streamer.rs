//! The streamer's entry: requests bricks, decodes what has come, and keeps it in the host cache. README.md beside this file
//! explains the whole.
//!
//! Protocol of one frame:
//! 1. [`Streamer::begin_frame`]; [`Streamer::begin_band`] if the rays are cast band by band.
//! 2. [`Streamer::begin_pass`]; the ray caster looks bricks up in [`Streamer::view`].
//! 3. [`Streamer::note_uses`] with the bricks that the pass used, then [`Streamer::fetch`] with the bricks it wanted.
//! 4. Repeat from 2 until no ray waits.
//!
//! Residency changes only within these calls; reading continues between them. The streamer knows nothing of rays.

use std::collections::{HashSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::container::toc::{BrickEntry, ENTRIES_PER_PAGE};
use supervol_format::readable::Mib;
use supervol_format::{Container, Lod};
use supervol_scene::value_map::ValueMap;

use crate::stop::Stop;
use crate::stream::budget::{HostPlan, decoded_bytes};
use crate::stream::cache::KeyMap;
use crate::stream::cache::host::{HostCache, Standing, Victims};
use crate::stream::cache::unpacked::UnpackedBricks;
use crate::stream::capacity::{Candidate, Supply, admit, needs_victims};
use crate::stream::classify::{Class, Classifier, holes_in};
use crate::stream::counters::{StreamCounters, milliseconds};
use crate::stream::field::{Field, FieldBrick};
use crate::stream::form::FormPolicy;
use crate::stream::held::HeldBrick;
use crate::stream::io;
use crate::stream::loader::{Finished, Loader};
use crate::stream::priority::{BrickOrder, Rank, Ranked};
use crate::stream::state::{BrickState, StateTable};
pub use crate::stream::view::{HostView, OnMissing};

/// Reason why the streamer cannot continue.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// The bricks that must stay leave no room for one more.
    #[error("the host cache of {} has no room for {key}: {} more are needed", Mib(*budget_bytes), Mib(*missing_bytes))]
    NoRoom {
        /// The first wanted brick.
        key: FieldBrick,
        /// Size of the cache, bytes.
        budget_bytes: u64,
        /// Missing bytes.
        missing_bytes: u64,
    },
    /// Reader threads cannot be started.
    #[error("the threads that read cannot be started: {0}")]
    Threads(String),
}

/// Limits of one tick besides the host cache.
#[derive(Debug, Clone)]
pub struct Room {
    /// Bricks that the ray caster can take.
    pub bricks: usize,
    /// Condition to stop waiting. Reads in progress continue.
    pub stop: Stop,
    /// Longest wait for more bricks once some ray can continue. `None`: wait for all that fit.
    pub patience: Option<Duration>,
}

/// Result of some ticks.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Fetched {
    /// Wanted bricks that are in the host cache now, front to back; at most `Room::bricks`.
    pub bricks: Vec<FieldBrick>,
    /// Wanted bricks that are nothing, uniform, too coarse or failed: answered without a brick.
    pub answered: Vec<FieldBrick>,
    /// Other bricks that this tick classified as nothing, uniform or too coarse.
    pub neighbours: Vec<FieldBrick>,
    /// Number of wanted bricks that are being read or must wait for a later tick.
    pub left: usize,
}

impl Fetched {
    /// Whether some ray can continue now.
    #[must_use]
    pub fn is_progress(&self) -> bool {
        !self.bricks.is_empty() || !self.answered.is_empty()
    }
}

/// Error bounds of the bricks that rays drew in one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DrawnErrors {
    /// Largest error bound of all bricks that rays drew, data units.
    pub bound: f64,
    /// Number of drawn bricks whose effect on the picture has no bound.
    pub without_bound: u64,
    /// Levels of the drawn bricks: bit n is level n.
    pub levels: u64,
}

/// Streamer: makes wanted bricks resident in host memory.
#[derive(Debug)]
pub struct Streamer {
    pub(crate) container: Arc<Container>,
    pub(crate) map: ValueMap,
    classifier: Classifier,
    /// Number of classifiers set before the current one.
    answers: u64,
    order: BrickOrder,
    pub(crate) plan: HostPlan,
    pub(crate) states: StateTable,
    pub(crate) cache: HostCache<HeldBrick>,
    /// Plain forms of packed bricks that rays entered last.
    pub(crate) unpacked: UnpackedBricks,
    /// Form of the bricks that come.
    pub(crate) form: FormPolicy,
    /// Plain bytes of the bricks that this frame used.
    pub(crate) working_set_bytes: u64,
    /// Repeated page-ins before this frame.
    pub(crate) repeated_before: u64,
    /// Bricks that are never evicted.
    pub(crate) kept: KeyMap<()>,
    /// Bricks that are too coarse, but in another state than `TooCoarse`: they stand in for children, or were read for
    /// another picture.
    pub(crate) stand_ins: KeyMap<()>,
    /// Bricks whose error bound has been counted in this frame.
    pub(crate) drawn: KeyMap<()>,
    /// Bricks wanted by the last request.
    pub(crate) wanted: KeyMap<()>,
    /// Bricks left in `Queued` by the last request.
    pub(crate) queued: Vec<FieldBrick>,
    /// Queued bricks that have room, front to back.
    pub(crate) due: VecDeque<Load>,
    pub(crate) victims: Victims,
    /// Bricks being loaded, for which room is reserved.
    pub(crate) loading: KeyMap<Load>,
    /// Finished reads that are not yet decoded.
    pub(crate) arrived: VecDeque<Finished>,
    /// Bytes of reads requested and not yet decoded.
    pub(crate) in_flight_bytes: u64,
    /// Started by the first read.
    pub(crate) loader: Option<Loader>,
    /// Attempts of bricks that failed in earlier frames and may be tried again.
    attempts: KeyMap<u32>,
    /// TOC pages of which every brick that needs no reading is in the state table.
    classified_pages: HashSet<u64>,
    /// First pass of this frame.
    first_pass: u64,
    /// First pass whose used bricks stay, if only spare room may be taken.
    kept_since: Option<u64>,
    pub(crate) counters: StreamCounters,
    /// Bytes of records read, by level.
    pub(crate) record_bytes: Vec<u64>,
    drawn_errors: DrawnErrors,
}

/// Purpose of a fetch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Purpose {
    /// To be drawn, if fine enough.
    Draw,
    /// To stand in for finer bricks, however coarse it is.
    StandIn,
}

/// A brick to be read.
#[derive(Debug, Clone, Copy)]
pub struct Load {
    pub(crate) key: FieldBrick,
    pub(crate) entry: BrickEntry,
    pub(crate) bytes: u64,
}

impl Streamer {
    /// A streamer with an empty cache.
    #[must_use]
    pub fn new(
        container: Arc<Container>,
        map: ValueMap,
        classifier: Classifier,
        order: BrickOrder,
        plan: HostPlan,
    ) -> Self {
        let levels = container.pyramid().levels().len();
        Self {
            map,
            classifier,
            answers: 0,
            order,
            plan,
            states: StateTable::new(levels),
            cache: HostCache::new(plan.cache_bytes),
            unpacked: UnpackedBricks::default(),
            form: FormPolicy::default(),
            working_set_bytes: 0,
            repeated_before: 0,
            kept: KeyMap::default(),
            stand_ins: KeyMap::default(),
            drawn: KeyMap::default(),
            wanted: KeyMap::default(),
            queued: Vec::new(),
            due: VecDeque::new(),
            victims: Victims::default(),
            loading: KeyMap::default(),
            arrived: VecDeque::new(),
            in_flight_bytes: 0,
            loader: None,
            attempts: KeyMap::default(),
            classified_pages: HashSet::new(),
            first_pass: 0,
            kept_since: None,
            counters: StreamCounters::default(),
            record_bytes: vec![0; levels],
            drawn_errors: DrawnErrors::default(),
            container,
        }
    }

    /// Changes the memory plan: drops bricks that no longer fit. Nothing is being loaded afterwards.
    pub fn set_plan(&mut self, plan: HostPlan) {
        self.plan = plan;
        self.divide_cache();
    }

    /// Begins a frame: bricks that failed long enough ago may be tried again.
    pub fn begin_frame(&mut self) {
        self.choose_form();
        self.attempts.extend(self.states.begin_frame());
        self.drawn.clear();
        self.drawn_errors = DrawnErrors::default();
        self.begin_band();
    }

    /// Begins a band of rays: bricks that earlier rays used are no longer live.
    pub fn begin_band(&mut self) {
        self.cache.begin_pass();
        self.first_pass = self.cache.pass();
    }

    /// From now on, bricks of the last frame and all that arrive later stay in the cache, and fetches use spare room
    /// only.
    pub fn keep_last_frame(&mut self) {
        self.kept_since = Some(self.first_pass);
    }

    /// Ends [`Self::keep_last_frame`].
    pub fn release_last_frame(&mut self) {
        self.kept_since = None;
    }

    /// Sets the order of another camera. If levels are chosen by brick, set another classifier too.
    pub fn set_order(&mut self, order: BrickOrder) {
        self.order = order;
    }

    /// Sets the classifier after a change of transfer function, mode or iso values; or of the camera, if levels are
    /// chosen by brick.
    pub fn set_classifier(&mut self, classifier: Classifier) {
        self.classifier = classifier;
        self.answers += 1;
        self.classified_pages.clear();
        self.states.reclassify();
        // Cached bricks are not classified again on request, so it is decided here whether they may be drawn.
        self.stand_ins = self.cache.keys().filter(|&key| self.is_too_coarse(key)).map(|key| (key, ())).collect();
    }

    /// Version of the classification: changes whenever bricks may be classified differently.
    #[must_use]
    pub fn answers(&self) -> u64 {
        self.answers
    }

    /// Whether the brick is too coarse: it must not be drawn while its children can be.
    #[must_use]
    pub fn is_too_coarse(&self, key: FieldBrick) -> bool {
        self.container.entry(key.brick).is_ok_and(|entry| self.class_of(key, &entry) == Class::TooCoarse)
    }

    /// Begins a pass. Takes in some bricks that arrived since the last pass, which may have had no time for them.
    pub fn begin_pass(&mut self) {
        self.cache.begin_pass();
        self.take_arrived();
    }

    /// The bricks that the ray caster may read in this pass: the container's one field.
    #[must_use]
    pub fn view(&self, on_missing: OnMissing) -> HostView<'_> {
        let held = (&self.cache, &self.unpacked);
        HostView::new(Field::FIRST, &self.container, &self.states, held, &self.stand_ins, on_missing)
    }

    /// Records the bricks that the pass used, and the number of its misses.
    pub fn note_uses(&mut self, used: &[FieldBrick], missed: u64) {
        let start = Instant::now();
        self.cache.note_uses(used, missed);
        if self.drawn.len() > self.plan.state_limit {
            self.drawn.clear();
        }
        for &key in used {
            if self.drawn.insert(key, ()).is_none()
                && let Ok(entry) = self.container.entry(key.brick)
            {
                self.count_error(key, &entry);
                let is_held = self.cache.get(key).is_some();
                self.working_set_bytes += if is_held { self.bytes_of(key) } else { 0 };
            }
        }
        self.counters.plan_ms += milliseconds(start.elapsed());
    }

    fn count_error(&mut self, FieldBrick { brick, .. }: FieldBrick, entry: &BrickEntry) {
        let has_bound = self.classifier.has_bound(brick, entry, || holes_in(&self.container, brick, entry));
        self.drawn_errors.without_bound += u64::from(!has_bound);
        let data_error = entry.error * self.container.descriptor().scale.abs();
        self.drawn_errors.bound = self.drawn_errors.bound.max(data_error);
        self.drawn_errors.levels |= 1 << brick.lod().0;
    }

    /// Fetches bricks that stay in the cache until the streamer is dropped: the fallback of all others.
    ///
    /// # Errors
    /// As [`Self::fetch`].
    ///
    /// # Panics
    /// As [`Self::fetch`].
    pub fn fetch_to_keep(&mut self, keys: &[FieldBrick], room: Room) -> Result<Fetched, StreamError> {
        self.kept.extend(keys.iter().map(|&key| (key, ())));
        let fetched = self.fetch_for(Purpose::StandIn, keys, room)?;
        self.kept.retain(|&key, ()| self.cache.get(key).is_some());
        Ok(fetched)
    }

    /// Makes wanted bricks resident, front to back, as far as room and patience allow. At least one, unless `room.stop`
    /// is due first.
    ///
    /// Bricks that cannot be read or decoded become failed and are answered so; the call succeeds.
    ///
    /// # Errors
    /// If no brick could be answered, because the bricks that stay leave no room for one more.
    ///
    /// # Panics
    /// If a brick is of a field that the container does not have.
    pub fn fetch(&mut self, wanted: &[FieldBrick], room: Room) -> Result<Fetched, StreamError> {
        self.fetch_for(Purpose::Draw, wanted, room)
    }

    fn fetch_for(&mut self, purpose: Purpose, wanted: &[FieldBrick], room: Room) -> Result<Fetched, StreamError> {
        if let Some(other) = wanted.iter().find(|key| key.field != Field::FIRST) {
            panic!("{other} is wanted of a container of one field");
        }
        loop {
            let mut fetched = self.request_for(purpose, wanted, &room)?;
            self.receive(&room, &mut fetched);
            // Bricks being loaded for earlier requests may have taken all the room. They have arrived now and may be
            // evicted.
            if fetched.is_progress() || wanted.is_empty() || room.stop.is_due() {
                return Ok(fetched);
            }
        }
    }

    fn request_for(&mut self, purpose: Purpose, wanted: &[FieldBrick], room: &Room) -> Result<Fetched, StreamError> {
        let start = Instant::now();
        let fetched = self.plan_requests(purpose, wanted, room);
        self.counters.plan_ms += milliseconds(start.elapsed());
        fetched
    }

    fn plan_requests(&mut self, purpose: Purpose, wanted: &[FieldBrick], room: &Room) -> Result<Fetched, StreamError> {
        // A ray that wants a brick known to be too coarse needs it in place of a failed child.
        let is_known = |key: &&FieldBrick| self.states.state(**key) == BrickState::TooCoarse;
        let wanted_to_stand_in: KeyMap<()> = wanted.iter().filter(is_known).map(|&key| (key, ())).collect();
        if self.states.forget(self.plan.state_limit) > 0 {
            self.classified_pages.clear();
            self.stand_ins.retain(|&key, ()| self.states.state(key) != BrickState::Unknown);
        }
        let ranked = self.order.ranked(self.container.pyramid(), wanted.iter().copied());
        self.cancel_all_but(ranked.iter().map(|r| (r.key, ())).collect());
        let Some(frontier) = ranked.first().map(|r| r.rank) else { return Ok(Fetched::default()) };

        // The table of contents decides some bricks; the rest are candidates for the cache.
        let waits = self.read_entries_ahead(&ranked, &room.stop);
        let mut fetched = Fetched::default();
        let mut candidates = Vec::new();
        let mut loads = KeyMap::default();
        for &Ranked { rank, key } in ranked.iter().filter(|ranked| !waits.contains_key(&ranked.key)) {
            let purpose = if wanted_to_stand_in.contains_key(&key) { Purpose::StandIn } else { purpose };
            match self.look_up(key, purpose, &mut fetched.neighbours) {
                Lookup::InHost => candidates.push(Candidate { key, rank, bytes: 0 }),
                Lookup::Answered => fetched.answered.push(key),
                Lookup::OnItsWay => {}
                Lookup::Load(load) => {
                    candidates.push(Candidate { key, rank, bytes: load.bytes });
                    loads.insert(key, load);
                }
            }
        }

        // Among equal ranks, resident bricks come first. If they or an answer let some ray continue, wanted bricks
        // stay. Otherwise the frontier may evict even those, the farthest first.
        candidates.sort_by_key(|c| (c.rank, c.bytes > 0, c.key));
        let is_served = !fetched.answered.is_empty() || candidates.first().is_some_and(|c| c.bytes == 0);
        let needs_victims = needs_victims(&candidates, self.cache.free_bytes(), self.cache.budget_bytes());
        let stays = |key| self.wanted.contains_key(&key).then_some(is_served);
        let victims = if needs_victims { self.victims(frontier, stays) } else { Victims::default() };

        let supply = Supply {
            unused_bytes: self.cache.free_bytes(),
            free_bytes: victims.free_bytes(),
            live_bytes: victims.live_bytes(),
            reserved_bytes: self.cache.reserved_bytes(),
            budget_bytes: self.cache.budget_bytes(),
            bricks: room.bricks,
        };
        let admitted = admit(&candidates, frontier, supply);
        if let (0, [], [first, ..], true) = (admitted, &fetched.answered[..], &candidates[..], self.is_idle()) {
            let available = supply.unused_bytes + supply.free_bytes + supply.live_bytes;
            let (budget_bytes, missing_bytes) = (supply.budget_bytes, first.bytes.saturating_sub(available));
            return Err(StreamError::NoRoom { key: first.key, budget_bytes, missing_bytes });
        }
        for Candidate { key, .. } in &candidates[..admitted] {
            match loads.get(key) {
                Some(load) => self.due.push_back(*load),
                None => fetched.bricks.push(*key),
            }
        }
        self.victims = victims;
        self.queued = loads.into_keys().collect();
        self.ask_for_due()?;
        Ok(fetched)
    }

    /// Reads the TOC entries of unknown bricks, front to back. Entries that cannot be read make their bricks fail one
    /// by one, at look-up. Returns the bricks whose entries could not be read in time: they wait.
    fn read_entries_ahead(&mut self, ranked: &[Ranked], stop: &Stop) -> KeyMap<()> {
        let (container, states) = (&self.container, &self.states);
        let unknown = || ranked.iter().map(|r| r.key).filter(|&key| states.state(key) == BrickState::Unknown);
        let bricks = || unknown().map(|key| key.brick);
        let read = |_: &mut StreamCounters| container.read_entries_ahead(bricks(), || !stop.is_due());
        io::patiently(&mut self.counters, stop, read).ok();
        if !stop.is_due() {
            return KeyMap::default();
        }
        unknown().filter(|&key| !container.has_entry(key.brick)).map(|key| (key, ())).collect()
    }

    /// Looks up a wanted brick. Afterwards its state is decided, or it is queued.
    fn look_up(&mut self, key: FieldBrick, purpose: Purpose, neighbours: &mut Vec<FieldBrick>) -> Lookup {
        let state = self.states.state(key);
        match state {
            BrickState::InHost => return Lookup::InHost,
            BrickState::Nothing(_) | BrickState::Uniform(_) | BrickState::Failed { .. } => return Lookup::Answered,
            BrickState::TooCoarse if purpose == Purpose::Draw => return Lookup::Answered,
            BrickState::Unknown | BrickState::TooCoarse | BrickState::Evicted | BrickState::Queued => {}
            BrickState::Reading => return Lookup::OnItsWay,
            BrickState::Decoding => unreachable!("{key} is left in state {state:?} between two ticks"),
        }
        let is_queued = state == BrickState::Queued;
        let entry = match self.container.entry(key.brick) {
            Ok(entry) => entry,
            Err(error) => {
                if is_queued {
                    self.states.cancel(key);
                }
                self.fail(key, error.to_string());
                return Lookup::Answered;
            }
        };
        match self.class_for(key, &entry, purpose) {
            Class::Load => {
                if !is_queued {
                    self.states.queue(key);
                }
                Lookup::Load(Load { key, entry, bytes: self.bytes_of(key) })
            }
            class => {
                if is_queued {
                    self.states.cancel(key);
                }
                self.enter_class(key, class);
                self.classify_neighbours(key, neighbours);
                Lookup::Answered
            }
        }
    }

    /// Class of a wanted brick.
    fn class_for(&mut self, key: FieldBrick, entry: &BrickEntry, purpose: Purpose) -> Class {
        let class = if self.stand_ins.contains_key(&key) { Class::TooCoarse } else { self.class_of(key, entry) };
        // Rays never ask for a brick that already stands in; they ask for a child.
        if class == Class::TooCoarse && (purpose == Purpose::StandIn || self.stand_ins.contains_key(&key)) {
            self.stand_ins.insert(key, ());
            return self.classifier.classify_drawn(entry);
        }
        class
    }

    pub(crate) fn class_of(&self, FieldBrick { brick, .. }: FieldBrick, entry: &BrickEntry) -> Class {
        self.classifier.classify(brick, entry, || holes_in(&self.container, brick, entry))
    }

    fn enter_class(&mut self, key: FieldBrick, class: Class) {
        match class {
            Class::Nothing(why) => self.states.nothing(key, why),
            Class::Uniform(value) => self.states.uniform(key, value),
            Class::TooCoarse => self.states.too_coarse(key),
            Class::Load => {}
        }
    }

    /// Classifies all other bricks of the same TOC page that need no reading. The page is in memory, and rays that
    /// cross empty space then need not stop at each of its bricks.
    fn classify_neighbours(&mut self, key: FieldBrick, neighbours: &mut Vec<FieldBrick>) {
        let per_page = ENTRIES_PER_PAGE as u64;
        let page = self.container.pyramid().entry(key.brick) / per_page;
        if self.states.len() + ENTRIES_PER_PAGE > self.plan.state_limit || !self.classified_pages.insert(page) {
            return;
        }
        for number in page * per_page..(page + 1) * per_page {
            let Some(brick) = self.container.pyramid().key(number) else { break };
            let neighbour = key.field.brick(brick);
            // A brick whose entry cannot be read fails when a ray wants it.
            if self.is_answered_by_entry(neighbour) {
                neighbours.push(neighbour);
            }
        }
    }

    /// Classifies an unknown brick if its entry suffices. Returns whether it did.
    fn is_answered_by_entry(&mut self, key: FieldBrick) -> bool {
        let (BrickState::Unknown, Ok(entry)) = (self.states.state(key), self.container.entry(key.brick)) else {
            return false;
        };
        let class = self.class_of(key, &entry);
        self.enter_class(key, class);
        class != Class::Load
    }

    /// Classifies bricks as far as their entries suffice and are in memory; returns those that it decided. After a
    /// change of look or camera this answers bricks again before rays ask.
    pub fn answer_again(&mut self, keys: impl IntoIterator<Item = FieldBrick>) -> Vec<FieldBrick> {
        let mut answered = Vec::new();
        for key in keys {
            let has_room = self.states.len() < self.plan.state_limit;
            if has_room && self.container.has_entry(key.brick) && self.is_answered_by_entry(key) {
                answered.push(key);
            }
        }
        answered
    }

    /// Bricks that may leave the cache. For a wanted brick, `stays` says whether it must stay; for all others it
    /// returns `None`.
    fn victims(&self, frontier: Rank, stays: impl Fn(FieldBrick) -> Option<bool>) -> Victims {
        let pyramid = self.container.pyramid();
        self.cache.victims(|key, last_used| {
            let rank = self.order.rank(pyramid, key.brick);
            match stays(key) {
                _ if self.kept.contains_key(&key) => Standing::Kept,
                _ if self.kept_since.is_some_and(|pass| last_used >= pass) => Standing::Kept,
                Some(true) => Standing::Kept,
                Some(false) => Standing::Live(rank),
                None if last_used < self.first_pass || rank < frontier => Standing::Free,
                None => Standing::Live(rank),
            }
        })
    }

    /// Bytes that a brick takes in the cache.
    pub(super) fn bytes_of(&self, key: FieldBrick) -> u64 {
        let shape = self.container.shape(key.brick);
        let cells: usize = self.container.pyramid().macro_cells(key.brick).iter().product();
        decoded_bytes(shape.voxel_type, &self.map, shape.voxels() as u64, cells as u64)
    }

    pub(crate) fn fail(&mut self, key: FieldBrick, reason: String) {
        let earlier = self.attempts.remove(&key).unwrap_or(0);
        self.states.fail(key, earlier, reason);
    }

    /// States of all bricks.
    #[must_use]
    pub fn states(&self) -> &StateTable {
        &self.states
    }

    /// The host cache.
    #[must_use]
    pub fn cache(&self) -> &HostCache<HeldBrick> {
        &self.cache
    }

    /// Counters of streaming since the streamer was made.
    #[must_use]
    pub fn counters(&self) -> StreamCounters {
        let mut sum = self.counters;
        sum.add(self.cache.counters());
        sum.add(self.states.counters());
        sum.bricks_unpacked += self.unpacked.unpacked();
        sum
    }

    /// Bytes of a level's records that were read since the streamer was made.
    #[must_use]
    pub fn record_bytes(&self, lod: Lod) -> u64 {
        self.record_bytes[lod.0 as usize]
    }

    /// Errors of the bricks that rays drew in this frame.
    #[must_use]
    pub fn drawn_errors(&self) -> DrawnErrors {
        self.drawn_errors
    }

    /// The container that the streamer reads.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        &self.container
    }
}

/// Result of looking up a wanted brick.
enum Lookup {
    InHost,
    Answered,
    OnItsWay,
    Load(Load),
}
