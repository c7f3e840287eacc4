//! View of bricks for ray casters: those in the host cache, and the states of all others.

use supervol_format::{BrickKey, Container};

use super::classify::holes_in;
use super::state::{BrickState, StateTable};
use crate::stream::cache::KeyMap;
use crate::stream::cache::host::HostCache;
use crate::stream::cache::unpacked::UnpackedBricks;
use crate::stream::field::{Field, FieldBrick};
use crate::stream::held::{BrickRef, HeldBrick};
use crate::stream::residency::{BrickView, KnownEntry, Resident};

/// Answer to a ray that meets a brick that is not resident.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnMissing {
    /// Rays wait for it.
    #[default]
    Wait,
    /// The nearest resident ancestor stands in: the picture is completed now.
    UseParent,
}

/// The bricks of one field in the host cache, and the states of all its other bricks.
#[derive(Debug, Clone, Copy)]
pub struct HostView<'a> {
    field: Field,
    container: &'a Container,
    states: &'a StateTable,
    cache: &'a HostCache<HeldBrick>,
    unpacked: &'a UnpackedBricks,
    stand_ins: &'a KeyMap<()>,
    on_missing: OnMissing,
}

impl<'a> HostView<'a> {
    /// A view of the field's bricks. `stand_ins` are too coarse for the rays that want them.
    pub(super) fn new(
        field: Field,
        container: &'a Container,
        states: &'a StateTable,
        (cache, unpacked): (&'a HostCache<HeldBrick>, &'a UnpackedBricks),
        stand_ins: &'a KeyMap<()>,
        on_missing: OnMissing,
    ) -> Self {
        Self { field, container, states, cache, unpacked, stand_ins, on_missing }
    }

    /// The field of these bricks.
    #[must_use]
    pub fn field(&self) -> Field {
        self.field
    }

    /// Answer to rays that meet bricks that are not resident.
    #[must_use]
    pub fn on_missing(&self) -> OnMissing {
        self.on_missing
    }

    /// The brick in the cache, in the form that it has there.
    #[inline]
    fn held(&self, key: FieldBrick) -> Option<BrickRef<'_>> {
        Some(match self.cache.get(key)? {
            HeldBrick::Plain(brick) => BrickRef::Plain(brick),
            HeldBrick::Packed(packed) => BrickRef::Packed(key, packed, self.unpacked),
        })
    }

    /// Answer for a brick that is in this state and not in the cache.
    #[inline]
    fn answer(&self, state: BrickState) -> Resident<'_> {
        match (state, self.on_missing) {
            (BrickState::Nothing(_), _) => Resident::Nothing,
            (BrickState::Uniform(value), _) => Resident::Uniform(value),
            (BrickState::Failed { .. }, _) | (_, OnMissing::UseParent) => Resident::UseParent,
            (_, OnMissing::Wait) => Resident::Missing,
        }
    }
}

impl BrickView for HostView<'_> {
    #[inline]
    fn lookup(&self, brick: BrickKey) -> Resident<'_> {
        let key = self.field.brick(brick);
        if !self.stand_ins.is_empty() && self.stand_ins.contains_key(&key) {
            return Resident::TooCoarse;
        }
        if let Some(brick) = self.held(key) {
            return Resident::Brick(brick);
        }
        match self.states.state(key) {
            BrickState::TooCoarse => Resident::TooCoarse,
            state => self.answer(state),
        }
    }

    #[inline]
    fn stand_in(&self, brick: BrickKey) -> Resident<'_> {
        let key = self.field.brick(brick);
        self.held(key).map_or_else(|| self.answer(self.states.state(key)), Resident::Brick)
    }

    fn entry(&self, key: BrickKey) -> Option<KnownEntry> {
        let entry = self.container.entry(key).ok()?;
        Some(KnownEntry { entry, holes: holes_in(self.container, key, &entry) })
    }
}
