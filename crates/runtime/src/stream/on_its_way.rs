//! Loading of bricks, from request to residence. The streamer reserves room, reader threads read records, and the
//! calling threads decode them into the cache. Reads that no ray wants any more and no thread has begun are cancelled.

use std::time::{Duration, Instant};

use supervol_format::container::ContainerError;

use super::classify::Class;
use super::decode::{self, Encoded};
use super::io::{RecordRequest, merge};
use super::loader::{Loader, QUEUE_LIMIT};
use super::state::BrickState;
use crate::stream::cache::KeyMap;
use crate::stream::cache::host::BRICK_OVERHEAD_BYTES;
use crate::stream::counters::milliseconds;
use crate::stream::field::FieldBrick;
use crate::stream::held::HeldBrick;
use crate::stream::streamer::{Fetched, Load, Room, StreamError, Streamer};

/// Bricks that each thread decodes before it checks the time.
const DECODED_AT_ONCE: usize = 2;
/// Longest wait for a read before a cancel request is checked.
const PATIENCE: Duration = Duration::from_millis(20);

impl Streamer {
    /// Requests due reads, as many as may be in flight.
    pub(super) fn ask_for_due(&mut self) -> Result<(), StreamError> {
        let (shape, limit) = (self.container.read_shape(), self.plan.in_flight_bytes);
        while !self.due.is_empty() {
            let pending = self.loader.as_ref().map_or(0, Loader::pending);
            let mut bytes = self.in_flight_bytes;
            let fits = |load: &&Load| {
                bytes += load.entry.record_bytes() + shape.gap_bytes;
                bytes <= limit
            };
            let count = self.due.iter().take(QUEUE_LIMIT - pending).take_while(fits).count();
            let count = self.with_room_for_plain(count);
            let count = if self.in_flight_bytes == 0 && pending < QUEUE_LIMIT { count.max(1) } else { count };
            if count == 0 {
                return Ok(());
            }
            self.loader()?;
            let batch: Vec<Load> = self.due.drain(..count).collect();
            self.make_room(&batch);
            let request =
                |l: &Load| RecordRequest { key: l.key, offset: l.entry.offset, bytes: l.entry.record_bytes() };
            for read in merge(batch.iter().map(request).collect(), shape, limit) {
                self.in_flight_bytes += read.in_flight_bytes();
                self.loader()?.ask(read);
            }
        }
        Ok(())
    }

    fn loader(&mut self) -> Result<&mut Loader, StreamError> {
        if self.loader.is_none() {
            self.loader = Some(Loader::new(&self.container).map_err(|e| StreamError::Threads(e.to_string()))?);
        }
        Ok(self.loader.as_mut().expect("it has just been started"))
    }

    /// Makes and reserves room in the cache for these bricks, and marks them as being read.
    fn make_room(&mut self, batch: &[Load]) {
        let bytes = batch.iter().map(|load| load.bytes).sum();
        let dropped = self.cache.make_room(bytes, &mut self.victims).expect("only bricks that fit are admitted");
        dropped.into_iter().for_each(|key| self.states.evict(key));
        self.cache.reserve(bytes);
        for load in batch {
            self.states.start_reading(load.key);
            self.loading.insert(load.key, *load);
        }
    }

    /// Waits for a finished read, at most until `until`, and makes some of the arrived bricks resident.
    pub(super) fn receive_some(&mut self, until: Option<Instant>, fetched: &mut Fetched) {
        let Some(loader) = &mut self.loader else { return };
        self.arrived.extend(loader.take_finished());
        if self.arrived.is_empty() {
            let start = Instant::now();
            let patience = start + PATIENCE;
            let finished = loader.wait(until.map_or(patience, |until| until.min(patience)));
            self.counters.wait_ms += milliseconds(start.elapsed());
            self.arrived.extend(finished);
        }
        self.take_some(fetched);
    }

    /// Makes some of the arrived bricks resident, without waiting.
    pub(super) fn take_arrived(&mut self) {
        let Some(loader) = &mut self.loader else { return };
        self.arrived.extend(loader.take_finished());
        // Rays that wait for such a brick ask again, and are answered from the cache.
        self.take_some(&mut Fetched::default());
    }

    fn take_some(&mut self, fetched: &mut Fetched) {
        self.decode_some(fetched);
        // The reader threads run already, so that this request cannot fail to start them.
        self.ask_for_due().expect("the loader runs");
    }

    /// Decodes some of the arrived records, and makes their bricks resident.
    fn decode_some(&mut self, fetched: &mut Fetched) {
        let most = DECODED_AT_ONCE * rayon::current_num_threads();
        let mut encoded = Vec::with_capacity(most);
        while encoded.len() < most
            && let Some(read) = self.arrived.front_mut()
        {
            let Some((key, record)) = read.answers.pop() else {
                self.counters.add(&read.counters);
                self.in_flight_bytes -= read.read.in_flight_bytes();
                self.arrived.pop_front();
                continue;
            };
            match record {
                Ok(record) => {
                    self.states.start_decoding(key);
                    self.record_bytes[key.lod().0 as usize] += record.bytes().len() as u64;
                    encoded.push(Encoded { key, entry: self.loading[&key].entry, record, spare: None });
                }
                Err(error) => self.settle(key, Err(error), fetched),
            }
        }
        let sizes: Vec<u64> = encoded.iter().map(|brick| self.loading[&brick.key].bytes).collect();
        for (brick, spare) in encoded.iter_mut().zip(self.cache.take_spares(&sizes)) {
            brick.spare = spare.and_then(HeldBrick::into_plain);
        }
        let start = Instant::now();
        let bricks = decode::decode_bricks(&self.container, &self.map, encoded, self.form.is_packed());
        self.counters.decode_ms += milliseconds(start.elapsed());
        bricks.into_iter().for_each(|(key, brick)| self.settle(key, brick, fetched));
    }

    /// Puts a loaded brick into the cache, or marks it as failed.
    fn settle(&mut self, key: FieldBrick, brick: Result<HeldBrick, ContainerError>, fetched: &mut Fetched) {
        let load = self.loading.remove(&key).expect("it was on its way");
        self.cache.release(load.bytes);
        let is_wanted = self.wanted.contains_key(&key);
        match brick {
            Ok(brick) => {
                self.counters.bytes_decoded += self.container.shape(key.brick).bytes() as u64;
                let bytes = match &brick {
                    HeldBrick::Plain(_) => load.bytes,
                    HeldBrick::Packed(packed) => packed.bytes() + BRICK_OVERHEAD_BYTES,
                };
                self.counters.bricks_packed += u64::from(matches!(brick, HeldBrick::Packed(_)));
                self.cache.insert(key, brick, bytes);
                self.states.in_host(key);
                // The transfer function may have changed since the request.
                if self.class_of(key, &load.entry) == Class::TooCoarse {
                    self.stand_ins.insert(key, ());
                }
                fetched.bricks.extend(is_wanted.then_some(key));
            }
            Err(error) => {
                self.fail(key, error.to_string());
                fetched.answered.extend(is_wanted.then_some(key));
            }
        }
    }

    /// Receives bricks and adds them to `fetched`, within the time that `room` allows.
    pub(super) fn receive(&mut self, room: &Room, fetched: &mut Fetched) {
        let end = room.patience.map(|patience| Instant::now() + patience);
        let is_enough = |fetched: &Fetched| fetched.is_progress() && end.is_some_and(|end| Instant::now() >= end);
        while !self.is_idle() && !room.stop.is_due() && !is_enough(fetched) {
            let until = end.filter(|_| fetched.is_progress());
            self.receive_some(room.stop.deadline().into_iter().chain(until).min(), fetched);
        }
        fetched.left = self.wanted.len() - fetched.bricks.len() - fetched.answered.len();
    }

    /// Whether no brick is being loaded or due.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.loading.is_empty() && self.due.is_empty()
    }

    /// Replaces the wanted bricks: reads for all others are cancelled, unless a thread has begun them.
    pub(super) fn cancel_all_but(&mut self, wanted: KeyMap<()>) {
        self.wanted = wanted;
        // Due bricks are decided anew.
        self.due.clear();
        for key in std::mem::take(&mut self.queued) {
            if self.states.state(key) == BrickState::Queued && !self.wanted.contains_key(&key) {
                self.states.cancel(key);
                self.counters.cancelled += 1;
            }
        }
        let waiting = self.loader.as_mut().map_or(Vec::new(), Loader::take_back);
        for read in waiting {
            if read.records.iter().any(|record| self.wanted.contains_key(&record.key)) {
                self.loader.as_mut().expect("it had the read").ask(read);
                continue;
            }
            self.in_flight_bytes -= read.in_flight_bytes();
            read.records.iter().for_each(|record| self.cancel_loading(record.key));
        }
        let mut arrived = std::mem::take(&mut self.arrived);
        for read in &mut arrived {
            let (wanted, others) = std::mem::take(&mut read.answers)
                .into_iter()
                .partition::<Vec<_>, _>(|(key, _)| self.wanted.contains_key(key));
            read.answers = wanted;
            others.into_iter().for_each(|(key, _)| self.cancel_loading(key));
        }
        self.arrived = arrived;
    }

    fn cancel_loading(&mut self, key: FieldBrick) {
        let load = self.loading.remove(&key).expect("it was on its way");
        self.cache.release(load.bytes);
        self.states.cancel(key);
        self.counters.cancelled += 1;
    }
}
