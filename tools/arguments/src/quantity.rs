//! Parsers of numbers: with units, fractions, percent, and lists.

use std::num::NonZero;
use std::str::FromStr;

use supervol::{ANY_ERROR, MAX_ERROR_LIMITS};
use supervol_format::cast::whole;
use supervol_format::{Dims, VoxelBox, VoxelType};
use supervol_scene::image::GREY_LEVELS;
use supervol_sources::Endian;
use supervol_sources::formats::segy::Offsets;
use supervol_sources::grid::placed::TIMES;

use crate::failure::Failure;

/// 8 EiB, more than any memory or file.
const MOST_BYTES: f64 = (1u64 << 63) as f64;

/// Value of `--offset`: bytes of a raw file, or traces of a SEG-Y file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Offset {
    /// Mean over all offsets.
    Stack,
    /// As it was written.
    Given(String),
}

/// An offset: `512`, `4KiB`, `-120`, `stack`.
///
/// # Errors
/// If the text is neither `stack`, nor a whole number, nor a size.
pub fn offset(text: &str) -> Result<Offset, String> {
    if text == "stack" {
        return Ok(Offset::Stack);
    }
    if text.parse::<i32>().is_err() {
        bytes(text).map_err(|e| format!("{e}, a whole number, or `stack`"))?;
    }
    Ok(Offset::Given(text.into()))
}

/// A trace number, or a range of them: `81`, `1-12`.
///
/// # Errors
/// If the text is neither, or numbers are not from 1 on.
pub fn traces(text: &str) -> Result<[u64; 2], String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let number = |text: &str| text.trim().parse::<u64>().ok().filter(|number| *number > 0);
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => Ok([first, last]),
        _ => Err("expected a trace number from 1 on, or a range such as 1-12".into()),
    }
}

impl Offset {
    /// Bytes before the voxels.
    ///
    /// # Errors
    /// If it is `stack`, or no number of bytes from 0 to 8 EiB.
    pub fn bytes(&self) -> Result<u64, Failure> {
        match self {
            Self::Stack => Err(Failure::command(
                "--offset stack: expected a number of bytes for a raw file (--dims); `stack` is for SEG-Y",
            )),
            Self::Given(text) => bytes(text).map_err(|e| Failure::command(format!("--offset: {e}"))),
        }
    }

    /// Traces of an unstacked file. A number with a unit is a number of bytes and selects no traces.
    pub fn traces(&self) -> Offsets {
        match self {
            Self::Stack => Offsets::Stack,
            Self::Given(text) => text.parse().map_or(Offsets::Single, Offsets::One),
        }
    }
}

/// Bytes: `1048576`, `64MiB`, `1GiB`, `500 MB`, `2G` (binary).
///
/// # Errors
/// If the text is no number with a known unit, or not from 0 to 8 EiB.
pub fn bytes(text: &str) -> Result<u64, String> {
    let (number, unit) = split_unit(text)?;
    let factor: f64 = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kib" => 1024.0,
        "m" | "mib" => 1024.0 * 1024.0,
        "g" | "gib" => 1024.0 * 1024.0 * 1024.0,
        "t" | "tib" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
        "p" | "pib" => 1024f64.powi(5),
        "e" | "eib" => 1024f64.powi(6),
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        "pb" => 1e15,
        "eb" => 1e18,
        _ => return Err(format!("unit '{unit}': expected B, KiB, MiB, GiB, TiB, PiB, EiB, kB, MB, GB, TB, PB or EB")),
    };
    let value = number * factor;
    if (0.0..=MOST_BYTES).contains(&value) {
        Ok(whole::<u64>(value))
    } else {
        Err(format!("{text}: expected a size from 0 to 8 EiB"))
    }
}

/// Milliseconds: `100`, `100ms`, `1.5 s`, `2min`.
///
/// # Errors
/// If the text is no number with a known unit, or not from 0 to 10^12 ms.
pub fn milliseconds(text: &str) -> Result<u64, String> {
    let (number, unit) = split_unit(text)?;
    let factor = match unit {
        "" | "ms" => 1.0,
        "s" => 1e3,
        "min" => 6e4,
        _ => return Err(format!("unit '{unit}': expected ms, s or min")),
    };
    let value = number * factor;
    if (0.0..1e12).contains(&value) {
        Ok(whole::<u64>(value))
    } else {
        Err(format!("{text}: expected a time of at least 0"))
    }
}

/// Splits a text into number and unit.
fn split_unit(text: &str) -> Result<(f64, &str), String> {
    let text = text.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || ".+-eE".contains(c))).unwrap_or(text.len());
    // In "1e3" the e is the number's; in "5EiB" it is the unit's.
    let end = text[..end].trim_end_matches(['e', 'E']).len();
    let number = f64::from_str(&text[..end]).map_err(|_| format!("'{text}': expected a number with a unit"))?;
    Ok((number, text[end..].trim()))
}

/// A list of N numbers: `1,2,3`.
fn list<T: FromStr, const N: usize>(text: &str, what: &str) -> Result<[T; N], String> {
    let wrong = || format!("'{text}': expected {N} {what}, separated by commas");
    let values: Vec<T> = text.split(',').map(|v| v.trim().parse().map_err(|_| wrong())).collect::<Result<_, _>>()?;
    values.try_into().map_err(|_| wrong())
}

/// Greatest number of threads: above the processors of any machine, and small enough to start them all.
const MOST_THREADS: usize = 1024;

/// A number of threads.
///
/// # Errors
/// If the text is no whole number from 1 to 1024.
pub fn threads(text: &str) -> Result<NonZero<usize>, String> {
    let number = text.trim().parse().ok().filter(|n: &NonZero<usize>| n.get() <= MOST_THREADS);
    number.ok_or_else(|| format!("'{text}': expected 1 to {MOST_THREADS} threads"))
}

/// `NX,NY,NZ` or `NXxNYxNZ`.
///
/// # Errors
/// If the text is not three numbers, or one of them is not an allowed number of voxels.
pub fn dims(text: &str) -> Result<Dims, String> {
    let dims = Dims(list(&text.replace(['x', 'X'], ","), "numbers of voxels")?);
    if dims.is_valid() { Ok(dims) } else { Err(format!("'{text}': expected 1 to {} voxels on each axis", Dims::LIMIT)) }
}

/// Pixels of a picture: `1024x768`.
///
/// # Errors
/// If the text is not two numbers from 1 to 32768.
pub fn image_size(text: &str) -> Result<[u32; 2], String> {
    let number = |t: &str| t.trim().parse::<u32>().ok().filter(|n| (1..=1 << 15).contains(n));
    let size = text.split_once('x').and_then(|(width, height)| Some([number(width)?, number(height)?]));
    size.ok_or_else(|| format!("'{text}': expected WIDTHxHEIGHT, 1 to 32768 pixels each"))
}

/// A pixel: `X,Y`.
///
/// # Errors
/// If the text is not two whole numbers of at least 0.
pub fn pixel(text: &str) -> Result<[u32; 2], String> {
    let number = |t: &str| t.trim().parse::<u32>().ok();
    let pixel = text.split_once(',').and_then(|(x, y)| Some([number(x)?, number(y)?]));
    pixel.ok_or_else(|| format!("'{text}': expected a pixel X,Y; 0,0 is at the top left"))
}

/// `X,Y,Z`.
///
/// # Errors
/// If the text is not three numbers.
pub fn triple(text: &str) -> Result<[f64; 3], String> {
    list(text, "numbers")
}

/// Nine numbers: the rows of a 3x3 matrix.
///
/// # Errors
/// If the text is not nine numbers.
pub fn matrix(text: &str) -> Result<[f64; 9], String> {
    list(text, "numbers")
}

/// Distances between voxels, with their unit; an empty unit means none.
#[derive(Debug, Clone, PartialEq)]
pub struct Spacing {
    /// Along x, y, z.
    pub lengths: [f64; 3],
    /// As it was written.
    pub unit: String,
}

/// Units of length in nanometres: whole numbers, so that conversions are exact.
const LENGTHS: [(&str, f64); 8] =
    [("nm", 1.0), ("um", 1e3), ("µm", 1e3), ("mm", 1e6), ("cm", 1e7), ("m", 1e9), ("km", 1e12), ("ft", 304_800_000.0)];

/// A unit of length or time.
///
/// # Errors
/// If the text is no known unit.
pub fn unit(text: &str) -> Result<String, String> {
    let lengths = LENGTHS.iter().map(|(name, _)| *name);
    let known: Vec<&str> = lengths.chain(TIMES).collect();
    if known.contains(&text) { Ok(text.into()) } else { Err(format!("'{text}': expected one of {}", known.join(", "))) }
}

/// `1,1,2`, `1mm,1mm,2mm` or `500um,500um,2mm`. The result is in the unit of the first length, or without unit.
///
/// # Errors
/// If the text is not three lengths, either all without units or all with known ones.
pub fn spacing(text: &str) -> Result<Spacing, String> {
    let parts: [String; 3] = list(text, "lengths")?;
    let expected = || {
        let units: Vec<&str> = LENGTHS.iter().map(|(name, _)| *name).collect();
        format!("'{text}': expected three lengths, all without units or all with one of {}", units.join(", "))
    };
    let nanometres = |unit: &str| LENGTHS.iter().find(|(name, _)| *name == unit).map(|(_, length)| *length);
    let unit = split_unit(&parts[0]).map_err(|_| expected())?.1.to_owned();
    let mut lengths = [0.0; 3];
    for (length, part) in lengths.iter_mut().zip(&parts) {
        let (number, own) = split_unit(part).map_err(|_| expected())?;
        *length = match (nanometres(own), nanometres(&unit)) {
            _ if own == unit && (unit.is_empty() || nanometres(&unit).is_some()) => number,
            (Some(own), Some(first)) => number * own / first,
            _ => return Err(expected()),
        };
    }
    Ok(Spacing { lengths, unit })
}

/// Box of voxels as on the command line: start, and optionally end, along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WrittenBox([(u64, Option<u64>); 3]);

impl WrittenBox {
    /// The box in a grid of this size. A missing end is the end of the grid.
    pub fn within(self, dims: Dims) -> VoxelBox {
        let end = |axis: usize| self.0[axis].1.unwrap_or(dims.0[axis]);
        VoxelBox { start: self.0.map(|(start, _)| start), end: [0, 1, 2].map(end) }
    }
}

/// `I0:I1,J0:J1,K0:K1`, ends excluded. Both ends are optional (`:` is all), and `50` means `50:51`.
///
/// # Errors
/// If the text is not three ranges, or a range ends before it begins.
pub fn voxel_box(text: &str) -> Result<WrittenBox, String> {
    let ranges: [String; 3] = list(text, "ranges I0:I1")?;
    let read = |range: &String| voxel_range(range.trim());
    Ok(WrittenBox([read(&ranges[0])?, read(&ranges[1])?, read(&ranges[2])?]))
}

fn voxel_range(text: &str) -> Result<(u64, Option<u64>), String> {
    let wrong = || format!("'{text}': expected I0:I1 with I0 < I1 (both are optional), or one voxel number");
    let number = |part: &str| part.trim().parse::<u64>().map_err(|_| wrong());
    let Some((start, end)) = text.split_once(':') else {
        let voxel = number(text)?;
        return voxel.checked_add(1).map(|end| (voxel, Some(end))).ok_or_else(wrong);
    };
    let start = if start.trim().is_empty() { 0 } else { number(start)? };
    let end = if end.trim().is_empty() { None } else { Some(number(end)?) };
    if end.is_some_and(|end| end <= start) { Err(wrong()) } else { Ok((start, end)) }
}

/// A voxel type with an optional byte order: `u16`, `f32be`, `i16le`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dtype {
    /// Type of a voxel.
    pub voxel_type: VoxelType,
    /// Byte order; little endian by default.
    pub endian: Endian,
}

/// Names of voxel types in other programs, and ours.
const OTHER_NAMES: [(&str, &str); 10] = [
    ("uint8", "u8"),
    ("int8", "i8"),
    ("uint16", "u16"),
    ("int16", "i16"),
    ("uint32", "u32"),
    ("int32", "i32"),
    ("float32", "f32"),
    ("float", "f32"),
    ("float64", "f64"),
    ("double", "f64"),
];

/// Parses a [`Dtype`].
///
/// # Errors
/// If the text is no name of a voxel type.
pub fn dtype(text: &str) -> Result<Dtype, String> {
    let lower = text.trim().to_ascii_lowercase();
    let (name, endian) = match (lower.strip_suffix("be"), lower.strip_suffix("le")) {
        (Some(name), _) => (name, Endian::Big),
        (_, Some(name)) => (name, Endian::Little),
        _ => (lower.as_str(), Endian::Little),
    };
    let name = OTHER_NAMES.iter().find(|(other, _)| *other == name).map_or(name, |(_, ours)| ours);
    let voxel_type = VoxelType::from_name(name).ok_or_else(|| {
        format!("'{text}': expected u8, i8, u16, i16, u32, i32, f32 or f64 (or uint8, ..., float64), optionally followed by be or le")
    })?;
    Ok(Dtype { voxel_type, endian })
}

/// Error bound: in data units (`0.5`), as a fraction (`0.5/255`), or in percent of the value range (`1%`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ErrorBound {
    /// Data units; [`picture_error`] interprets it as a fraction of full scale.
    Absolute(f64),
    /// Percent of the value range.
    Percent(f64),
}

/// Parses an [`ErrorBound`].
///
/// # Errors
/// If the text is no number of at least 0, no percentage and no quotient.
pub fn error_bound(text: &str) -> Result<ErrorBound, String> {
    let wrong = || format!("'{text}': expected a number that is not negative, such as 0.5, 0.5/255 or 1%");
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite() && *v >= 0.0).ok_or_else(wrong);
    if let Some(percent) = text.trim().strip_suffix('%') {
        return Ok(ErrorBound::Percent(number(percent)?));
    }
    match text.split_once('/') {
        Some((a, b)) => {
            let divisor = number(b)?;
            if divisor > 0.0 { Ok(ErrorBound::Absolute(number(a)? / divisor)) } else { Err(wrong()) }
        }
        None => Ok(ErrorBound::Absolute(number(text)?)),
    }
}

/// Parses the allowed error of a picture as a fraction of full scale: within the limits of the renderer, or 1 for any
/// error.
///
/// Other values are refused, because the renderer would silently clamp them to its limits.
///
/// # Errors
/// If the text is no [`ErrorBound`], or its value is outside the limits and not 1.
pub fn picture_error(text: &str) -> Result<f64, String> {
    let error = match error_bound(text)? {
        ErrorBound::Absolute(error) => error,
        ErrorBound::Percent(percent) => percent / 100.0,
    };
    let [least, greatest] = MAX_ERROR_LIMITS;
    if (least..=greatest).contains(&error) || error == ANY_ERROR {
        return Ok(error);
    }
    let levels = |error: f64| format!("{}/255", (error * GREY_LEVELS * 1e4).round() / 1e4);
    // A number without divisor probably means grey levels.
    let means_levels = (least..=greatest).contains(&(error / GREY_LEVELS)) && text.trim().parse::<f64>().is_ok();
    let advice = if means_levels { format!("; for {text} grey levels, give {text}/255") } else { String::new() };
    Err(format!(
        "expected {} to {} of full scale, or {ANY_ERROR} (levels of detail by pixel size alone); found {text}, which is {}{advice}",
        levels(least),
        levels(greatest),
        levels(error),
    ))
}

/// Formats bytes with three digits and a binary unit.
pub fn show_bytes(bytes: u64) -> String {
    indicatif::BinaryBytes(bytes).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_take_binary_and_decimal_units() {
        for (text, expected) in [
            ("4096", 4096),
            ("1GiB", 1 << 30),
            ("1.5 MiB", 3 << 19),
            ("2MB", 2_000_000),
            ("64k", 65536),
            ("2PiB", 1 << 51),
            ("8 EiB", 1 << 63),
            ("1EiB", 1 << 60),
            ("2eb", 2_000_000_000_000_000_000),
        ] {
            assert_eq!(bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "GiB", "-1", "1 parsec", "1e30GiB", "9EiB"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }

    #[test]
    fn types_boxes_and_errors_are_read() {
        assert_eq!(dtype("f32be"), Ok(Dtype { voxel_type: VoxelType::F32, endian: Endian::Big }));
        assert_eq!(dtype("u8"), Ok(Dtype { voxel_type: VoxelType::U8, endian: Endian::Little }));
        assert!(dtype("u12").is_err());
        let within = |text: &str| voxel_box(text).map(|b| b.within(Dims([10, 20, 30])));
        assert_eq!(within("0:4,1:2, 3:9"), Ok(VoxelBox { start: [0, 1, 3], end: [4, 2, 9] }));
        assert_eq!(within(":,:,25"), Ok(VoxelBox { start: [0, 0, 25], end: [10, 20, 26] }));
        assert_eq!(within("2:,:3,:"), Ok(VoxelBox { start: [2, 0, 0], end: [10, 3, 30] }));
        for text in ["4:4,0:1,0:1", ":0,:,:", ":,:", "a,:,:", "-1,:,:", "18446744073709551615,:,:"] {
            assert!(within(text).is_err(), "{text}");
        }
        assert_eq!(error_bound("0.5/255"), Ok(ErrorBound::Absolute(0.5 / 255.0)));
        assert_eq!(error_bound("1%"), Ok(ErrorBound::Percent(1.0)));
        assert!(error_bound("-1").is_err());
        for (text, levels) in
            [("0.05/255", 0.05), ("16/255", 16.0), ("1%", 2.55), ("0.002", 0.51), ("1", 255.0), ("100%", 255.0)]
        {
            let found = picture_error(text).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert!((found * GREY_LEVELS - levels).abs() < 1e-9, "{text}: {found}");
        }
        for text in ["0", "0.04/255", "0.0001", "17/255", "0.5", "50%", "2", "1/0", "-1/255", "nan"] {
            let refused = picture_error(text).expect_err(text);
            assert!(refused.contains("expected") && refused.contains(text), "{text}: {refused}");
        }
        let advised =
            |text: &str| picture_error(text).is_err_and(|message| message.contains(&format!("give {text}/255")));
        assert!(
            advised("0.5") && advised("2") && advised("16") && !advised("0") && !advised("17/255") && !advised("17")
        );
        assert_eq!(threads("1024").map(NonZero::get), Ok(1024));
        for text in ["0", "1025", "10000", "18446744073709551615", "-1", "two"] {
            assert!(threads(text).is_err_and(|message| message.contains("1 to 1024")), "{text}");
        }
        assert_eq!(dims("256x128X3"), Ok(Dims([256, 128, 3])));
        assert_eq!(dtype("uint16be").map(|d| (d.voxel_type, d.endian)), Ok((VoxelType::U16, Endian::Big)));
        assert_eq!(dtype("float32").map(|d| d.voxel_type), Ok(VoxelType::F32));
        assert_eq!(spacing("1,1,2").map(|s| (s.lengths, s.unit)), Ok(([1.0, 1.0, 2.0], String::new())));
        let mixed = spacing("500um, 500um, 2mm").expect("lengths");
        assert!((mixed.lengths[2] - 2000.0).abs() < 1e-9 && mixed.unit == "um", "{mixed:?}");
        for text in ["1mm,1,2", "1,1,2mm", "1s,1s,1s", "1mm,1mm", "mm,mm,mm"] {
            assert!(spacing(text).is_err_and(|e| e.contains("expected")), "{text}");
        }
        assert!(dims("10,0,3").is_err() && dims("1,2").is_err());
        assert_eq!(image_size("1024x768"), Ok([1024, 768]));
        assert!(image_size("1024").is_err() && image_size("0x4").is_err() && image_size("4x-3").is_err());
    }
}
