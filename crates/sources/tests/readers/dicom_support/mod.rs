//! Writer of small DICOM files, element by element.

#![allow(dead_code, reason = "each test binary uses a part")]
#![allow(clippy::unwrap_used, reason = "these are tests: they fail loudly")]

/// Data set in explicit little endian.
#[derive(Clone, Default)]
pub struct Dicom(pub Vec<u8>);

impl Dicom {
    /// Adds an element; text and values of odd length are padded as the format demands.
    pub fn with(mut self, tag: u32, kind: &str, value: impl AsRef<[u8]>) -> Self {
        let mut value = value.as_ref().to_vec();
        if value.len() % 2 == 1 {
            value.push(if kind == "UI" || kind == "OB" { 0 } else { b' ' });
        }
        let length = value.len() as u32;
        self.header(tag, kind, length);
        self.0.extend(value);
        self
    }

    pub fn word(self, tag: u32, value: u16) -> Self {
        self.with(tag, "US", value.to_le_bytes())
    }

    /// Adds a sequence of items, with explicit lengths or with delimiters.
    pub fn sequence(mut self, tag: u32, items: &[Dicom], is_delimited: bool) -> Self {
        let bytes: u32 = items.iter().map(|item| item.0.len() as u32 + 8).sum();
        self.header(tag, "SQ", if is_delimited { u32::MAX } else { bytes });
        for item in items {
            self.bare(0xfffe_e000, if is_delimited { u32::MAX } else { item.0.len() as u32 });
            self.0.extend(&item.0);
            if is_delimited {
                self.bare(0xfffe_e00d, 0);
            }
        }
        if is_delimited {
            self.bare(0xfffe_e0dd, 0);
        }
        self
    }

    /// Adds compressed pixels: an offset table and fragments.
    pub fn fragments(mut self, fragments: &[Vec<u8>]) -> Self {
        self.header(0x7fe0_0010, "OB", u32::MAX);
        self.bare(0xfffe_e000, 0);
        for fragment in fragments {
            self.bare(0xfffe_e000, fragment.len() as u32);
            self.0.extend(fragment);
        }
        self.bare(0xfffe_e0dd, 0);
        self
    }

    /// The file with this data set.
    pub fn file(&self, syntax: &str) -> Vec<u8> {
        let group = Self::default().with(0x0002_0010, "UI", syntax);
        let length = (group.0.len() as u32).to_le_bytes();
        let group = Self::default().with(0x0002_0000, "UL", length).0.into_iter().chain(group.0);
        [vec![0; 128], b"DICM".to_vec(), group.collect(), self.0.clone()].concat()
    }

    fn header(&mut self, tag: u32, kind: &str, length: u32) {
        self.0.extend(((tag >> 16) as u16).to_le_bytes());
        self.0.extend((tag as u16).to_le_bytes());
        self.0.extend(kind.as_bytes());
        if ["OB", "OW", "SQ", "UN", "UT"].contains(&kind) {
            self.0.extend([0; 2]);
            self.0.extend(length.to_le_bytes());
        } else {
            self.0.extend((length as u16).to_le_bytes());
        }
    }

    fn bare(&mut self, tag: u32, length: u32) {
        self.0.extend(((tag >> 16) as u16).to_le_bytes());
        self.0.extend((tag as u16).to_le_bytes());
        self.0.extend(length.to_le_bytes());
    }
}

pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const RLE: &str = "1.2.840.10008.1.2.5";

/// A slice of 5 x 4 pixels of i16.
#[derive(Clone)]
pub struct Slice {
    pub series: &'static str,
    pub number: u16,
    pub instance: u16,
    pub position: [f64; 3],
    pub orientation: &'static str,
    pub slope: &'static str,
    pub stored_bits: u16,
    pub size: [u16; 2],
}

impl Default for Slice {
    fn default() -> Self {
        Self {
            series: "1.2.3",
            number: 1,
            instance: 1,
            position: [0.0; 3],
            orientation: "1\\0\\0\\0\\1\\0",
            slope: "1",
            stored_bits: 16,
            size: [5, 4],
        }
    }
}

impl Slice {
    /// All elements but the pixels.
    pub fn header(&self) -> Dicom {
        let [x, y, z] = self.position;
        Dicom::default()
            .with(0x0008_0060, "CS", "CT")
            .with(0x0008_103e, "LO", "a head")
            .with(0x0018_0050, "DS", "2.5")
            .with(0x0020_000e, "UI", self.series)
            .with(0x0020_0011, "IS", self.number.to_string())
            .with(0x0020_0013, "IS", self.instance.to_string())
            .with(0x0020_0032, "DS", format!("{x}\\{y}\\{z}"))
            .with(0x0020_0037, "DS", self.orientation)
            .word(0x0028_0002, 1)
            .with(0x0028_0004, "CS", "MONOCHROME2")
            .word(0x0028_0010, self.size[1])
            .word(0x0028_0011, self.size[0])
            .with(0x0028_0030, "DS", "0.5\\0.25")
            .word(0x0028_0100, 16)
            .word(0x0028_0101, self.stored_bits)
            .word(0x0028_0102, self.stored_bits - 1)
            .word(0x0028_0103, 1)
            .with(0x0028_1052, "DS", "-1024")
            .with(0x0028_1053, "DS", self.slope)
    }

    pub fn file(&self, voxels: &[u8]) -> Vec<u8> {
        self.header().with(0x7fe0_0010, "OW", voxels).file(EXPLICIT)
    }
}

/// One PackBits segment per byte of 16-bit pixels, high bytes first, all literal.
pub fn rle(voxels: &[u8]) -> Vec<u8> {
    let segment = |byte: usize| -> Vec<u8> {
        let bytes: Vec<u8> = voxels.chunks(2).map(|voxel| voxel[byte]).collect();
        bytes.chunks(100).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect()
    };
    let (high, low) = (segment(1), segment(0));
    let mut header = vec![0; 64];
    for (i, word) in [2, 64, 64 + high.len() as u32].into_iter().enumerate() {
        header[4 * i..4 * i + 4].copy_from_slice(&word.to_le_bytes());
    }
    let mut frame = [header, high, low].concat();
    frame.resize(frame.len().next_multiple_of(2), 0);
    frame
}
