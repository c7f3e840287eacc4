//! Host side of the page table: the entry of each brick, and changes of entries before the next pass.
//!
//! The entries of the fields follow one another; those of a field are in the order of its pyramid. So an entry is the
//! index in the table of contents plus the first entry of its field. A shader that draws a field adds that number to
//! the first entry of each level. The words themselves are on the device and are written there ([`super::cache`]).

use supervol_format::cast::narrow;
use supervol_format::{Lod, Pyramid};

use crate::stream::field::{Field, FieldBrick};

/// Content of an entry: state and payload.
pub type Page = [u32; 2];

/// Host side of the page table, see the module.
#[derive(Debug)]
pub struct PageTable {
    /// The pyramid of each field, and its first entry.
    fields: Vec<(u64, Pyramid)>,
    count: u64,
    /// Changes to be written, in the order of the calls.
    pending: Vec<(u32, Page)>,
}

impl PageTable {
    /// A table for the bricks of fields, numbered from [`Field::FIRST`], with these pyramids.
    ///
    /// # Panics
    /// If there are more fields than field numbers.
    #[must_use]
    pub fn new(pyramids: impl IntoIterator<Item = Pyramid>) -> Self {
        let (mut fields, mut count) = (Vec::new(), 0);
        for pyramid in pyramids {
            let first = count;
            count += pyramid.brick_count();
            fields.push((first, pyramid));
        }
        assert!(fields.len() <= 1 << u16::BITS, "{} fields", fields.len());
        Self { fields, count, pending: Vec::new() }
    }

    /// Entries of all fields.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The entry of a brick.
    ///
    /// # Panics
    /// If the table has no such brick, or more entries than 32 bits count: renderers refuse those.
    #[must_use]
    pub fn entry(&self, FieldBrick { field, brick }: FieldBrick) -> u32 {
        let (first, pyramid) = &self.fields[usize::from(field.0)];
        entry_u32(first + pyramid.entry(brick))
    }

    /// The first entry of a field's levels above its finest.
    ///
    /// # Panics
    /// As [`Self::entry`].
    #[must_use]
    pub fn first_coarse_entry(&self, field: Field) -> u32 {
        let (first, pyramid) = &self.fields[usize::from(field.0)];
        entry_u32(first + pyramid.level_at(Lod::FINEST).brick_count())
    }

    /// The brick of an entry; `None` beyond the last.
    #[must_use]
    pub fn brick(&self, entry: u32) -> Option<FieldBrick> {
        let entry = u64::from(entry);
        let number = self.fields.partition_point(|(first, _)| *first <= entry).checked_sub(1)?;
        let (first, pyramid) = &self.fields[number];
        Some(Field(narrow::<u16>(number)).brick(pyramid.key(entry - first)?))
    }

    /// Records the content of an entry for the next pass.
    pub fn set(&mut self, entry: u32, page: Page) {
        self.pending.push((entry, page));
    }

    /// The changes since the last call: by entry, the last change of each.
    pub fn take_changes(&mut self) -> Vec<(u32, Page)> {
        let mut pending = std::mem::take(&mut self.pending);
        // A stable sort keeps the changes of one entry in order; only the last is kept.
        pending.sort_by_key(|&(entry, _)| entry);
        pending.reverse();
        pending.dedup_by_key(|&mut (entry, _)| entry);
        pending.reverse();
        pending
    }

    /// Forgets the recorded changes.
    pub fn clear(&mut self) {
        self.pending.clear();
    }
}

fn entry_u32(entry: u64) -> u32 {
    u32::try_from(entry).expect("a table with more entries than 32 bits count is refused")
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey, BrickLayout, Dims};

    use super::*;

    const MISSING: Page = [0, 0];

    fn pyramid(dims: [u64; 3]) -> Pyramid {
        Pyramid::new(Dims(dims), BrickLayout::new(16).unwrap(), &[[2, 2, 2], [2, 2, 2]]).unwrap()
    }

    /// Fields of 4 x 3 x 2, of 2 x 2 x 3 and again of 4 x 3 x 2 bricks at level 0.
    fn table() -> PageTable {
        PageTable::new([[64, 48, 32], [32, 32, 48], [64, 48, 32]].map(pyramid))
    }

    #[test]
    fn every_brick_of_every_field_has_an_entry_of_its_own() {
        let table = table();
        let mut next = 0;
        for (field, (_, pyramid)) in (0..).map(Field).zip(&table.fields) {
            for number in 0..pyramid.brick_count() {
                let brick = field.brick(pyramid.key(number).unwrap());
                assert_eq!((table.entry(brick), table.brick(next)), (next, Some(brick)), "{brick}");
                next += 1;
            }
        }
        assert_eq!((table.count(), table.brick(next)), (u64::from(next), None));
        for field in [0, 1, 2].map(Field) {
            let first_coarse = table.brick(table.first_coarse_entry(field)).unwrap();
            assert_eq!(first_coarse, field.brick(BrickKey::new(Lod(1), BrickIndex([0; 3]))));
        }
        assert_eq!(PageTable::new([]).brick(0), None);
    }

    #[test]
    fn the_first_field_s_entries_are_those_of_the_table_of_contents() {
        let pyramid = pyramid([64, 48, 32]);
        let numbers = 0..pyramid.brick_count();
        let is_same = |n: u64| u64::from(table().entry(Field::FIRST.brick(pyramid.key(n).unwrap()))) == n;
        assert!(numbers.into_iter().all(is_same));
    }

    #[test]
    fn a_page_of_one_field_is_not_that_of_another_and_the_last_note_counts() {
        let mut table = table();
        let mut device = vec![MISSING; table.count() as usize];
        let mut write = |table: &mut PageTable| {
            table.take_changes().into_iter().for_each(|(entry, page)| device[entry as usize] = page);
            device.clone()
        };
        let key = BrickKey::new(Lod(0), BrickIndex([1, 1, 0]));
        let entries = [0, 1, 2].map(|field| table.entry(Field(field).brick(key)));
        table.set(entries[0], [9, 9]);
        for (&entry, payload) in entries.iter().zip(7..) {
            table.set(entry, [2, payload]);
        }
        let pages = |device: &[Page]| entries.map(|entry| device[entry as usize]);
        assert_eq!(pages(&write(&mut table)), [[2, 7], [2, 8], [2, 9]]);
        table.set(entries[1], MISSING);
        let written = write(&mut table);
        assert_eq!(pages(&written), [[2, 7], MISSING, [2, 9]]);
        assert_eq!(written.iter().filter(|&&page| page != MISSING).count(), 2);
        table.set(entries[0], MISSING);
        table.clear();
        assert_eq!(table.take_changes(), []);
    }
}
