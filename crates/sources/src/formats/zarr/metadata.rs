//! Metadata of an array, `.zarray` (version 2) or `zarr.json` (version 3): shape, element type, names and encoding of
//! the chunks.

use std::path::Path;

use half::f16;
use serde::Deserialize;
use serde_json::Value;
use supervol_format::voxel_type::Voxel;
use supervol_format::{VoxelType, with_voxel};

use super::codecs::Codec;
use crate::cast::index;
use crate::grid::chunked::{AXES_LIMIT, ArrayShape};
use crate::grid::elements::Number;
use crate::input::text::shortened;
use crate::{Endian, SourceError};

/// Contents of `.zarray`.
#[derive(Debug, Deserialize)]
pub(super) struct Version2 {
    shape: Vec<u64>,
    chunks: Vec<u64>,
    dtype: Value,
    #[serde(default)]
    compressor: Option<Value>,
    #[serde(default)]
    filters: Option<Vec<Value>>,
    #[serde(default)]
    pub(super) fill_value: Value,
    #[serde(default)]
    order: Option<String>,
    #[serde(default)]
    dimension_separator: Option<String>,
}

/// Contents of `zarr.json`, of an array or a group.
#[derive(Debug, Deserialize)]
pub(super) struct Version3 {
    pub(super) node_type: String,
    /// Attributes, of which an array or a group has other ones.
    #[serde(default)]
    pub(super) attributes: Value,
    #[serde(default)]
    shape: Vec<u64>,
    #[serde(default)]
    data_type: Value,
    chunk_grid: Option<Named>,
    chunk_key_encoding: Option<Named>,
    #[serde(default)]
    fill_value: Value,
    #[serde(default)]
    codecs: Vec<Named>,
    #[serde(default)]
    pub(super) dimension_names: Option<Vec<Option<String>>>,
    #[serde(default)]
    storage_transformers: Vec<Value>,
}

/// A name with or without its options.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Named {
    Plain(String),
    With {
        name: String,
        #[serde(default)]
        configuration: Value,
    },
}

impl Named {
    fn parts(&self) -> (&str, &Value) {
        match self {
            Self::Plain(name) => (name, &Value::Null),
            Self::With { name, configuration } => (name, configuration),
        }
    }
}

/// Naming scheme of the chunks, from their numbers along the axes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Keys {
    /// Whether `c` precedes the numbers (version 3).
    pub(super) prefix: bool,
    pub(super) separator: char,
    /// Whether the last axis comes first (N5).
    pub(super) is_reversed: bool,
}

impl Keys {
    /// The name of a chunk.
    pub(super) fn name(&self, number: &[u64]) -> String {
        let mut parts: Vec<String> = number.iter().map(u64::to_string).collect();
        if self.is_reversed {
            parts.reverse();
        }
        if self.prefix {
            parts.insert(0, "c".into());
        }
        parts.join(&self.separator.to_string())
    }
}

/// Files that hold several chunks each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Sharding {
    /// Chunks of a file along each axis.
    pub(super) count: Vec<u64>,
    /// Format of the chunk index of a file.
    pub(super) index: Index,
}

/// Format of a shard's index: whether it has a checksum, and whether it is at the end of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Index {
    pub(super) has_checksum: bool,
    pub(super) at_end: bool,
}

/// An array as described by its metadata.
#[derive(Debug, Clone)]
pub(super) struct Array {
    pub(super) number: Number,
    pub(super) shape: ArrayShape,
    pub(super) keys: Keys,
    pub(super) stages: Vec<Codec>,
    pub(super) sharding: Option<Sharding>,
    /// Whether chunks are N5 blocks, which have headers.
    pub(super) has_block_headers: bool,
}

/// Path of the metadata, for errors.
#[derive(Clone, Copy)]
struct At<'a>(&'a Path);

impl At<'_> {
    fn invalid(self, location: &str, expected: &str, found: impl std::fmt::Display) -> SourceError {
        SourceError::invalid(self.0, location, expected, shortened(&found.to_string()))
    }

    fn unsupported(self, what: String) -> SourceError {
        SourceError::unsupported(self.0, what, "write the array anew without it, for example with Python's zarr")
    }
}

/// Checks the rules that all versions share.
pub(super) fn check_shape(path: &Path, shape: &[u64], chunk: &[u64]) -> Result<(), SourceError> {
    let at = At(path);
    let found = || format!("shape {shape:?}, chunks {chunk:?}");
    if shape.is_empty() || shape.len() > AXES_LIMIT || shape.len() != chunk.len() {
        return Err(at.invalid("shape", &format!("1 to {AXES_LIMIT} axes, and a chunk of as many"), found()));
    }
    let is_positive = |sizes: &[u64]| sizes.iter().all(|n| (1..=i64::MAX as u64).contains(n));
    if !is_positive(shape) || !is_positive(chunk) {
        return Err(at.invalid("shape", "at least one element on each axis, of the array and of its chunks", found()));
    }
    Ok(())
}

impl Version2 {
    pub(super) fn array(self, path: &Path) -> Result<Array, SourceError> {
        let at = At(path);
        check_shape(path, &self.shape, &self.chunks)?;
        let (number, endian) = type_of_version_2(at, &self.dtype)?;
        let mut stages = Vec::new();
        for filter in self.filters.iter().flatten().chain(&self.compressor).filter(|codec| !codec.is_null()) {
            stages.push(codec_of_version_2(at, filter)?);
        }
        let axes = 0..self.shape.len();
        let stored = match self.order.as_deref().unwrap_or("C") {
            "F" => axes.rev().collect(),
            "C" => axes.collect(),
            other => return Err(at.invalid("order", "C or F", other)),
        };
        let separator = separator(at, self.dimension_separator.as_deref().unwrap_or("."))?;
        let fill = fill_of(at, &self.fill_value, number)?;
        let shape = ArrayShape { shape: self.shape, chunk: self.chunks, stored, endian, fill };
        let keys = Keys { prefix: false, separator, is_reversed: false };
        Ok(Array { number, shape, keys, stages, sharding: None, has_block_headers: false })
    }
}

impl Version3 {
    pub(super) fn array(self, path: &Path) -> Result<Array, SourceError> {
        let at = At(path);
        if self.storage_transformers.iter().any(|t| t["must_understand"] != false) {
            return Err(at.unsupported("it has storage transformers".into()));
        }
        let grid = self.chunk_grid.as_ref().map_or(("none", &Value::Null), Named::parts);
        if grid.0 != "regular" {
            return Err(at.unsupported(format!("chunks on a grid `{}`, not a regular one", shortened(grid.0))));
        }
        let chunk = sizes(at, "chunk_shape", &grid.1["chunk_shape"])?;
        check_shape(path, &self.shape, &chunk)?;
        let Value::String(name) = &self.data_type else {
            return Err(at.unsupported(format!("data type {}", shortened(&self.data_type.to_string()))));
        };
        let number = number_of(at, name)?;
        let fill = fill_of(at, &self.fill_value, number)?;
        let shape =
            ArrayShape { stored: (0..chunk.len()).collect(), shape: self.shape, chunk, endian: Endian::Little, fill };
        let keys = self.chunk_key_encoding.as_ref().map_or(("default", &Value::Null), Named::parts);
        let (prefix, usual) = match keys.0 {
            "default" => (true, "/"),
            "v2" => (false, "."),
            other => return Err(at.unsupported(format!("chunk key encoding `{}`", shortened(other)))),
        };
        let separator = separator(at, keys.1["separator"].as_str().unwrap_or(usual))?;
        let keys = Keys { prefix, separator, is_reversed: false };
        let mut array = Array { number, shape, keys, stages: Vec::new(), sharding: None, has_block_headers: false };
        array.decode_by(at, &self.codecs)?;
        Ok(array)
    }
}

impl Array {
    /// Applies the codecs of version 3, given in encoding order.
    fn decode_by(&mut self, at: At<'_>, codecs: &[Named]) -> Result<(), SourceError> {
        let mut has_bytes = false;
        for codec in codecs {
            let (name, options) = codec.parts();
            match name {
                "sharding_indexed" if !has_bytes && self.sharding.is_none() && codecs.len() == 1 => {
                    self.shard(at, options)?;
                    has_bytes = true;
                }
                "sharding_indexed" => {
                    return Err(at.unsupported("shards inside shards, or beside other codecs".into()));
                }
                "numcodecs.bitround" | "bitround" if !has_bytes => {}
                "numcodecs.quantize" if !has_bytes && keeps_type(options) => {}
                "transpose" if !has_bytes => self.transpose(at, options)?,
                "bytes" | "endian" if !has_bytes => {
                    has_bytes = true;
                    self.shape.endian = endian_of(at, options)?;
                }
                _ if has_bytes => self.stages.push(codec_of_version_3(at, name, options)?),
                other => return Err(at.unsupported(format!("codec `{}`", shortened(other)))),
            }
        }
        if has_bytes { Ok(()) } else { Err(at.invalid("codecs", "a codec `bytes`", "none")) }
    }

    fn transpose(&mut self, at: At<'_>, options: &Value) -> Result<(), SourceError> {
        let rank = self.shape.shape.len();
        let order: Vec<usize> = match &options["order"] {
            Value::String(order) if order == "C" => (0..rank).collect(),
            Value::String(order) if order == "F" => (0..rank).rev().collect(),
            other => sizes(at, "transpose", other)?.into_iter().map(index).collect(),
        };
        let mut sorted = order.clone();
        sorted.sort_unstable();
        if !sorted.into_iter().eq(0..rank) {
            return Err(at.invalid("transpose", "each axis once", format!("{order:?}")));
        }
        self.shape.stored = order.into_iter().map(|axis| self.shape.stored[axis]).collect();
        Ok(())
    }

    /// Makes the chunks inside shards the array's chunks.
    fn shard(&mut self, at: At<'_>, options: &Value) -> Result<(), SourceError> {
        let inner = sizes(at, "chunk_shape of shards", &options["chunk_shape"])?;
        check_shape(at.0, &self.shape.shape, &inner)?;
        let outer = &self.shape.chunk;
        if outer.iter().zip(&inner).any(|(outer, inner)| !outer.is_multiple_of(*inner)) {
            return Err(at.invalid("chunk_shape of shards", &format!("a divisor of {outer:?}"), format!("{inner:?}")));
        }
        let count = outer.iter().zip(&inner).map(|(outer, inner)| outer / inner).collect();
        let index: Vec<Named> = Deserialize::deserialize(&options["index_codecs"])
            .map_err(|e: serde_json::Error| at.invalid("index_codecs", "codecs", e))?;
        let names: Vec<&str> = index.iter().map(|codec| codec.parts().0).collect();
        let has_checksum = match names[..] {
            ["bytes" | "endian"] => false,
            ["bytes" | "endian", "crc32c"] => true,
            _ => return Err(at.unsupported(format!("an index of shards by {}", shortened(&names.join(", "))))),
        };
        if endian_of(at, index[0].parts().1)? != Endian::Little {
            return Err(at.unsupported("an index of shards in big endian".into()));
        }
        let at_end = match options["index_location"].as_str().unwrap_or("end") {
            "end" => true,
            "start" => false,
            other => return Err(at.invalid("index_location", "start or end", other)),
        };
        let codecs: Vec<Named> = Deserialize::deserialize(&options["codecs"])
            .map_err(|e: serde_json::Error| at.invalid("codecs of shards", "codecs", e))?;
        self.shape.chunk = inner;
        self.sharding = Some(Sharding { count, index: Index { has_checksum, at_end } });
        self.decode_by(at, &codecs)
    }
}

fn separator(at: At<'_>, text: &str) -> Result<char, SourceError> {
    match text {
        "." => Ok('.'),
        "/" => Ok('/'),
        other => Err(at.invalid("separator", "`.` or `/`", other)),
    }
}

fn sizes(at: At<'_>, what: &str, value: &Value) -> Result<Vec<u64>, SourceError> {
    let numbers: Option<Vec<u64>> = value.as_array().and_then(|a| a.iter().map(Value::as_u64).collect());
    numbers.filter(|n| n.len() <= AXES_LIMIT).ok_or_else(|| at.invalid(what, "a list of whole numbers", value))
}

fn endian_of(at: At<'_>, options: &Value) -> Result<Endian, SourceError> {
    match options["endian"].as_str().unwrap_or("little") {
        "little" => Ok(Endian::Little),
        "big" => Ok(Endian::Big),
        other => Err(at.invalid("endian", "little or big", other)),
    }
}

fn number_of(at: At<'_>, name: &str) -> Result<Number, SourceError> {
    number_named(name).ok_or_else(|| at.unsupported(format!("elements of type `{}`", shortened(name))))
}

/// The type with this name in Zarr 3 and N5.
pub(super) fn number_named(name: &str) -> Option<Number> {
    Some(match name {
        "uint8" | "bool" => Number::Voxel(VoxelType::U8),
        "int8" => Number::Voxel(VoxelType::I8),
        "uint16" => Number::Voxel(VoxelType::U16),
        "int16" => Number::Voxel(VoxelType::I16),
        "uint32" => Number::Voxel(VoxelType::U32),
        "int32" => Number::Voxel(VoxelType::I32),
        "float16" => Number::Half,
        "float32" => Number::Voxel(VoxelType::F32),
        "float64" => Number::Voxel(VoxelType::F64),
        "int64" => Number::Whole { signed: true },
        "uint64" => Number::Whole { signed: false },
        _ => return None,
    })
}

/// NumPy's type names: byte order, kind, bytes.
fn type_of_version_2(at: At<'_>, dtype: &Value) -> Result<(Number, Endian), SourceError> {
    let text = dtype.as_str().unwrap_or_default();
    let name = match text.get(1..) {
        Some("b1") => "bool",
        Some("u1") => "uint8",
        Some("i1") => "int8",
        Some("u2") => "uint16",
        Some("i2") => "int16",
        Some("u4") => "uint32",
        Some("i4") => "int32",
        Some("u8") => "uint64",
        Some("i8") => "int64",
        Some("f2") => "float16",
        Some("f4") => "float32",
        Some("f8") => "float64",
        _ => return Err(at.unsupported(format!("elements of type {}", shortened(&dtype.to_string())))),
    };
    let endian = if text.starts_with('>') { Endian::Big } else { Endian::Little };
    Ok((number_of(at, name)?, endian))
}

fn codec_of_version_2(at: At<'_>, codec: &Value) -> Result<Codec, SourceError> {
    Ok(match codec["id"].as_str().unwrap_or_default() {
        "gzip" => Codec::Gzip,
        "zlib" => Codec::Zlib,
        "zstd" => Codec::Zstd,
        "blosc" => Codec::Blosc,
        "lz4" => Codec::Lz4,
        "crc32c" => Codec::Crc32c,
        "bitround" => Codec::Rounding,
        "quantize" if keeps_type(codec) => Codec::Rounding,
        "shuffle" => Codec::Shuffle(element_bytes(at, &codec["elementsize"])?),
        _ => return Err(at.unsupported(format!("it is encoded by {}", shortened(&codec.to_string())))),
    })
}

/// Whether a filter writes the type that it reads.
fn keeps_type(options: &Value) -> bool {
    options["astype"].is_null() || options["astype"] == options["dtype"]
}

fn codec_of_version_3(at: At<'_>, name: &str, options: &Value) -> Result<Codec, SourceError> {
    Ok(match name {
        "gzip" | "numcodecs.gzip" => Codec::Gzip,
        "zlib" | "numcodecs.zlib" => Codec::Zlib,
        "zstd" | "numcodecs.zstd" => Codec::Zstd,
        "blosc" | "numcodecs.blosc" => Codec::Blosc,
        "crc32c" => Codec::Crc32c,
        "numcodecs.lz4" => Codec::Lz4,
        "numcodecs.shuffle" => Codec::Shuffle(element_bytes(at, &options["elementsize"])?),
        _ => return Err(at.unsupported(format!("codec `{}`", shortened(name)))),
    })
}

fn element_bytes(at: At<'_>, value: &Value) -> Result<usize, SourceError> {
    let bytes = value.as_u64().filter(|n| (1..=256).contains(n));
    bytes.map(index).ok_or_else(|| at.invalid("shuffle", "elements of 1 to 256 bytes", value))
}

/// Little-endian bytes of the fill value; 0 if there is none.
fn fill_of(at: At<'_>, value: &Value, number: Number) -> Result<[u8; 8], SourceError> {
    let wrong = || at.invalid("fill_value", "a number of the array's type", value);
    let mut bytes = [0; 8];
    if let Number::Whole { .. } = number {
        let whole = match value {
            Value::Null => Some(0),
            Value::Number(n) => n.as_u64().or_else(|| n.as_i64().map(i64::cast_unsigned)),
            _ => None,
        };
        return whole.map(u64::to_le_bytes).ok_or_else(wrong);
    }
    let voxel_type = number.stored();
    if let Some(hex) = value.as_str().and_then(|text| text.strip_prefix("0x")) {
        // The bits of a float.
        let bits = u64::from_str_radix(hex, 16).map_err(|_| wrong())?;
        bytes = bits.to_le_bytes();
        return if bytes[voxel_type.bytes()..].iter().all(|b| *b == 0) { Ok(bytes) } else { Err(wrong()) };
    }
    let value = match value {
        Value::Null => 0.0,
        Value::Bool(is_set) => f64::from(u8::from(*is_set)),
        Value::Number(n) => n.as_f64().ok_or_else(wrong)?,
        Value::String(text) => match text.as_str() {
            "NaN" => f64::NAN,
            "Infinity" => f64::INFINITY,
            "-Infinity" => f64::NEG_INFINITY,
            _ => return Err(wrong()),
        },
        _ => return Err(wrong()),
    };
    if number == Number::Half {
        bytes[..2].copy_from_slice(&f16::from_f64(value).to_le_bytes());
        return Ok(bytes);
    }
    with_voxel!(voxel_type, V => V::from_f64(value).write_le(&mut bytes[..size_of::<V>()]));
    Ok(bytes)
}
