//! Whether four-byte samples are IBM or IEEE floats, judged from their bits.
//!
//! Both formats are sign, exponent, fraction, and either reads as the other without any impossible value: IBM data
//! taken for IEEE come out roughly square-rooted, IEEE data taken for IBM roughly squared. What tells them apart is
//! the nibble of bits 20 to 23. IBM numbers are normalised to base 16, so that it is their leading digit and never
//! zero. In IEEE numbers it is the last exponent bit and the first three fraction bits: zero in about one of 16.
//!
//! The judgement is only used to refuse a file whose header contradicts it, and only where it is very sure; an
//! explicit `format` is never judged. The traces looked at are spread evenly and always the same.

use std::collections::HashSet;

use super::input::Input;
use super::layout::Layout;
use super::samples::{SampleFormat, say_format};
use crate::{Endian, Message, SourceError};

/// Traces looked at.
const TRACES: u64 = 64;

/// Samples looked at in the middle of each trace.
const SAMPLES: u64 = 4096;

/// Counts over the non-zero words of the sampled traces.
#[derive(Debug, Default)]
struct Words {
    total: u64,
    /// Bits 20 to 23 zero: unnormalised as IBM.
    zero_nibble: u64,
    /// Bit 23 zero: as IEEE, one in eight of these has a zero nibble.
    even_exponent: u64,
    /// First byte zero: what fixed point with gain looks like.
    zero_byte: u64,
    /// As IEEE: not finite, or outside 2^-60 to 2^60.
    wild_ieee: u64,
    /// As IBM: outside 16^-16 to 16^16.
    wild_ibm: u64,
    /// IEEE exponents among the words counted in `even_exponent`.
    even_exponents: HashSet<u32>,
    /// IEEE exponents among all words.
    exponents: HashSet<u32>,
    distinct: HashSet<u32>,
}

impl Words {
    fn add(&mut self, word: u32) {
        if word & 0x7FFF_FFFF == 0 {
            return;
        }
        self.total += 1;
        self.zero_nibble += u64::from(word & 0x00F0_0000 == 0);
        self.zero_byte += u64::from(word >> 24 == 0);
        let ieee_exponent = (word >> 23) & 0xFF;
        self.exponents.insert(ieee_exponent);
        if ieee_exponent.is_multiple_of(2) {
            self.even_exponent += 1;
            self.even_exponents.insert(ieee_exponent);
        }
        self.wild_ieee += u64::from(!(67..=187).contains(&ieee_exponent));
        self.wild_ibm += u64::from(!(48..=80).contains(&((word >> 24) & 0x7F)));
        if self.distinct.len() < 1000 {
            self.distinct.insert(word);
        }
    }

    /// Surely IEEE: a noticeable share could not be normalised IBM numbers, and all make sense as IEEE. Files of
    /// unnormalised IBM numbers, if there are any, have no share above 90 % to fear.
    fn surely_ieee(&self) -> bool {
        self.total >= 256
            && self.zero_nibble * 100 >= self.total
            && self.zero_nibble * 10 <= self.total * 9
            && self.wild_ieee * 1000 <= self.total
    }

    /// Whether the words with an even exponent span enough exponents to be judged.
    fn spans_exponents(&self) -> bool {
        let [Some(least), Some(greatest)] = [self.even_exponents.iter().min(), self.even_exponents.iter().max()] else {
            return false;
        };
        let are_neighbours = *greatest == least + 2 && self.exponents.contains(&(least + 1));
        self.even_exponents.len() >= 3 || (are_neighbours && self.even_exponent >= 1024)
    }

    /// Surely IBM: not one zero nibble, where IEEE would have made one in about eight of at least 256 words, over
    /// several exponents and many values (so that no single binade or set of labels explains it). Two exponents are
    /// enough for four times as many words if the exponent between them occurs: IEEE numbers that pass from one to the
    /// other would have zero nibbles.
    fn surely_ibm(&self) -> bool {
        self.total >= 1024
            && self.zero_nibble == 0
            && self.even_exponent >= 256
            && self.spans_exponents()
            && self.distinct.len() >= 100
            && self.wild_ibm == 0
    }
}

/// Refuses files whose sample format is declared as 1 (IBM) or 5 (IEEE) and is surely the other, and all files of
/// format 4, which is obsolete and more often a mistake than meant.
pub(super) fn check_format(input: Input<'_>, layout: &Layout) -> Result<(), SourceError> {
    if !matches!(layout.format, SampleFormat::Ibm32 | SampleFormat::F32 | SampleFormat::FixedPointWithGain) {
        return Ok(());
    }
    let words = sample_words(input, layout)?;
    let shares = format!("{} of {} non-zero samples are unnormalised as IBM floats", words.zero_nibble, words.total);
    match layout.format {
        SampleFormat::Ibm32 if words.surely_ieee() => Err(input.unsupported(
            format!(
                "the header says IBM float (format 1 in bytes 3225-3226), but the samples are IEEE floats: {shares}"
            ),
            say_format("say ", "5").text(" to read them as IEEE, or ").message(say_format("", "1")).text(" to insist"),
        )),
        SampleFormat::F32 if words.surely_ibm() => Err(input.unsupported(
            format!(
                "the header says IEEE float (format 5 in bytes 3225-3226), but the samples are IBM floats: {shares}"
            ),
            say_format("say ", "1").text(" to read them as IBM, or ").message(say_format("", "5")).text(" to insist"),
        )),
        SampleFormat::FixedPointWithGain => Err(refuse_format_4(input, &words)),
        _ => Ok(()),
    }
}

/// Error for format 4, with the format that the samples resemble.
fn refuse_format_4(input: Input<'_>, words: &Words) -> SourceError {
    let what = "sample format 4 (fixed point with gain, bytes 3225-3226), which is obsolete and not read";
    let (looks, advice) = if words.total > 0 && words.zero_byte == words.total {
        ("the samples look like it", Message::from("convert the file to format 5"))
    } else if words.total > 0 && words.zero_nibble == 0 && words.wild_ibm == 0 {
        ("but the samples look like IBM floats", say_format("if they are, say ", "1"))
    } else if words.wild_ieee == 0 && words.total > 0 {
        ("but the samples look like IEEE floats", say_format("if they are, say ", "5"))
    } else {
        ("the samples look like neither IBM nor IEEE floats", say_format("if you know the format, say ", "N"))
    };
    input.unsupported(format!("{what}; {looks}"), advice)
}

/// Reads the sample words of evenly spread traces.
fn sample_words(input: Input<'_>, layout: &Layout) -> Result<Words, SourceError> {
    let mut words = Words::default();
    let traces = layout.traces.min(TRACES);
    let samples = layout.samples.min(SAMPLES);
    let mut buffer = vec![0; samples as usize * 4];
    for index in 0..traces {
        let trace = index * layout.traces / traces;
        let offset = layout.sample_offset(trace, (layout.samples - samples) / 2);
        input.read(offset, &mut buffer)?;
        for word in buffer.as_chunks::<4>().0 {
            words.add(if layout.endian == Endian::Big { u32::from_be_bytes(*word) } else { u32::from_le_bytes(*word) });
        }
    }
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(values: impl Iterator<Item = u32>) -> Words {
        let mut words = Words::default();
        values.for_each(|w| words.add(w));
        words
    }

    /// A wavelet train with amplitudes over three decades.
    fn amplitudes() -> impl Iterator<Item = f64> {
        (1..4000).map(|i| (f64::from(i) * 0.37).sin() * 1000.0 * (-f64::from(i % 500) / 90.0).exp())
    }

    /// IBM bits of a value: the largest exponent that keeps the fraction below 1.
    fn ibm(value: f64) -> u32 {
        let exponent = (value.abs().log2() / 4.0).floor() as i32 + 1;
        let fraction = (value.abs() / 16f64.powi(exponent) * f64::from(1 << 24)) as u32;
        (u32::from(value < 0.0) << 31) | (((exponent + 64) as u32) << 24) | fraction.min(0x00FF_FFFF)
    }

    #[test]
    fn formats_are_told_apart_and_never_mistaken() {
        let ieee = words(amplitudes().map(|v| (v as f32).to_bits()));
        assert!(ieee.surely_ieee() && !ieee.surely_ibm());
        let ibm = words(amplitudes().map(ibm));
        assert!(ibm.surely_ibm() && !ibm.surely_ieee());
    }

    #[test]
    fn narrow_data_are_not_judged() {
        // Velocities of one binade, and a few labels: too little to be sure of anything.
        let velocity = words((0..5000).map(|i| (1500.0 + 0.1 * i as f32).to_bits()));
        assert!(!velocity.surely_ibm());
        // Two binades and the one between them.
        let velocity = words((0..5000).map(|i| (600.0 + 0.5 * i as f32).to_bits()));
        assert!(!velocity.surely_ibm());
        let labels = words((0..5000).map(|i| ([1.0_f32, 3.0, 5.0, 6.0, 7.0][i % 5]).to_bits()));
        assert!(!labels.surely_ibm());
    }
}
