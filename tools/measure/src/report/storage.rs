//! Cost of building and storing volumes: figures and tables of [`crate::storage`], and figures with other codecs from a
//! stored record. A summary has one figure and two short tables: builds of the largest size, and lossless coding.

use supervol_format::codec::CodecChoice;

use super::Extent;
use super::html::{bytes, escape, figure, grid, number, paragraph, table};
use super::palette::{self, Look};
use super::plots::{Plot, Series};
use crate::measure::Spread;
use crate::storage::builds::{Built, MEMORY_BYTES};
use crate::storage::codecs::Rates;
use crate::storage::{CHOICES, Storage};

/// Goal of lossless building on two otherwise idle cores, MB/s.
const BUILD_GOAL_MB_S: f64 = 150.0;
/// Record of `tools/rates.py`, which compares codecs brick by brick, and its date.
const BESIDE_OTHERS: &str = include_str!("../../../../benches/rates/epyc-zen5-2-cores-2026-11-26.csv");
const BESIDE_OTHERS_ON: &str = "2026-11-26";
/// Lossy codecs of that record, at the greatest error of Supervol's codec; and Supervol's codec.
const OTHERS: [&str; 2] = ["zfp equal", "SZ3 equal"];
const OURS: &str = "ours auto";

/// The section of the report.
pub(super) fn section(storage: &Storage, extent: Extent) -> String {
    if storage.builds.is_empty() && storage.rates.is_empty() {
        return paragraph("Building and storing were not measured in this run.");
    }
    let always = builds(&storage.builds, extent) + &rates(&storage.rates, extent);
    if extent == Extent::Whole { always + &beside_others() } else { always }
}

/// A line, or single points, for each codec with data.
fn series_of<'a, T>(
    measured: &'a [T],
    is_joined: bool,
    points: impl Fn(&'a T, &str) -> Option<(f64, f64)>,
) -> Vec<Series> {
    let of_codec = |(place, name): (usize, &str)| Series {
        name: name.into(),
        look: Look { joined: is_joined, ..palette::look(name, place) },
        points: measured.iter().filter_map(|m| points(m, name)).collect(),
    };
    CHOICES.map(CodecChoice::name).into_iter().enumerate().map(of_codec).filter(|s| !s.points.is_empty()).collect()
}

/// Throughput and memory by size.
fn builds(builds: &[Built], extent: Extent) -> String {
    let against_size = |y_label, time: fn(&Built) -> Spread| {
        let at = |b: &Built| (b.volume_bytes() as f64 / 1e6, b.megabytes_per_second(time(b)));
        let series = series_of(builds, true, |b, codec| (b.codec == codec).then(|| at(b)));
        Plot::of_lines(["volume, MB", y_label], series)
    };
    let by_clock = Plot {
        limit: Some((BUILD_GOAL_MB_S, "goal, 2 cores, lossless".into())),
        ..against_size("MB of the volume a second, by the clock", |b| b.wall)
    };
    let by_processor = against_size("MB of the volume a second of processor time", |b| b.cpu);
    let mut figures = vec![
        figure(
            "Building, by the clock",
            &by_clock.html(),
            "Higher is faster. From opening a raw file that the page cache holds to a container that is on the disk: small \
             volumes wait for the disk.",
        ),
        figure(
            "Building, by processor time",
            &by_processor.html(),
            "All threads together: what others do on the machine matters less here.",
        ),
    ];
    let largest = builds.iter().map(|b| b.edge).max();
    let is_shown = |b: &&Built| extent == Extent::Whole || Some(b.edge) == largest;
    if extent == Extent::Summary {
        figures.truncate(1);
    }
    let row = |b: &Built| {
        let (fastest, slowest) = (b.wall.least_ms / 1e3, b.wall.greatest_ms / 1e3);
        vec![
            escape(b.codec),
            format!("{0}³", b.edge),
            format!("{} ({} to {})", number(b.wall.median_ms / 1e3), number(fastest), number(slowest)),
            number(b.megabytes_per_second(b.wall)),
            number(b.megabytes_per_second(b.cpu)),
            b.peak_bytes.map_or_else(|| "\u{2013}".into(), bytes),
            number(b.container_bytes as f64 / b.volume_bytes() as f64),
        ]
    };
    let headings =
        ["codec", "voxels", "s (fastest to slowest)", "MB/s", "MB/s of CPU time", "memory", "container / volume"];
    paragraph(&format!(
        "A synthetic survey of bytes is built into a container, coarser levels, value ranges, error bounds and checksums included, \
         with the memory that users get who ask for nothing else (--memory {}). Memory is the most that the process has resident, \
         beside what it had before the first build.",
        bytes(MEMORY_BYTES).replace(".0 ", " ")
    )) + &grid(&figures)
        + &table(&headings, &builds.iter().filter(is_shown).map(row).collect::<Vec<_>>())
}

/// Bits per voxel and decoding speed, by codec.
fn rates(rates: &[Rates], extent: Extent) -> String {
    let at = |r: &Rates, codec: &str| {
        let found = r.codecs.iter().find(|f| f.codec == codec)?;
        Some((r.bits(found) / (8 * r.voxel_type.bytes()) as f64, found.decode_mb_s))
    };
    let plot = Plot::of_lines(
        ["bits that are left, share", "decoded voxels, MB a second of processor time"],
        series_of(rates, false, at),
    );
    let row = |r: &Rates| {
        let of_codec = |f| format!("{}; {}", number(r.bits(f)), number(f.decode_mb_s.round()));
        let share = if r.share == 0.0 { "0".into() } else { format!("{} %", number(100.0 * r.share)) };
        let about = [escape(&format!("{}, {}", r.name, r.voxel_type)), share];
        // Raw voxels have the bits of their type, so they get no column.
        about.into_iter().chain(r.codecs.iter().filter(|f| f.codec != "raw").map(of_codec)).collect()
    };
    let headings: Vec<&str> =
        ["volume", "error"].into_iter().chain(CHOICES.map(CodecChoice::name)).filter(|h| *h != "raw").collect();
    let is_shown = |r: &&Rates| extent == Extent::Whole || r.share == 0.0;
    let figure = figure(
        "Decoding against bits",
        &plot.html(),
        "A mark is one volume within one error: further left is smaller, further up is decoded faster.",
    );
    let about = paragraph(
        "Bricks of 64³ voxels with their aprons, coded one by one as --codec says; within an error, the share of the range that \
         no voxel may be further off than. In the table: bits per voxel; MB of voxels that one thread decodes in a second.",
    );
    let table = table(&headings, &rates.iter().filter(is_shown).map(row).collect::<Vec<_>>());
    if extent == Extent::Whole { about + &figure + &table } else { about + &table }
}

/// Bits of another codec and of Supervol's codec at the same greatest error.
fn pairs(record: &str, other: &str) -> Vec<(f64, f64)> {
    let fields = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    let lines: Vec<Vec<String>> = record.lines().skip(1).map(fields).collect();
    let bits = |data: &str, share: &str, codec: &str| {
        let is_it = |line: &&Vec<String>| line.len() > 4 && line[0] == data && line[2] == share && line[3] == codec;
        lines.iter().find(is_it).and_then(|line| line[4].parse::<f64>().ok())
    };
    let pair = |line: &Vec<String>| Some((bits(&line[0], &line[2], other)?, bits(&line[0], &line[2], OURS)?));
    lines.iter().filter(|line| line.len() > 4 && line[3] == other).filter_map(pair).collect()
}

/// Figures of the record with other codecs.
fn beside_others() -> String {
    let series: Vec<Series> = OTHERS
        .iter()
        .enumerate()
        .map(|(place, other)| Series {
            name: other.replace(" equal", ""),
            look: Look { joined: false, ..palette::look(other, place) },
            points: pairs(BESIDE_OTHERS, other),
        })
        .collect();
    let ends = series.iter().flat_map(|s| &s.points).flat_map(|&(a, b)| [a, b]);
    let (low, high) = ends.fold((f64::INFINITY, 0.0f64), |(low, high), bits| (low.min(bits), high.max(bits)));
    let count = |s: &Series| {
        let fewer = s.points.iter().filter(|(other, ours)| ours < other).count();
        format!("fewer bits than {} in {fewer} of {}", s.name, s.points.len())
    };
    let counted: Vec<String> = series.iter().map(count).collect();
    let reading = format!(
        "A mark is one volume within one error; below the dashed line ours takes fewer bits at the same greatest error ({}). \
         Measured on {BESIDE_OTHERS_ON} by tools/rates.py, not in this run; speeds and plain codecs are in docs/measurements.md, \
         \"Beside other codecs\".",
        counted.join(", ")
    );
    let plot = Plot {
        guides: vec![vec![(low, low), (high, high)]],
        ..Plot::of_lines(["bits per voxel of the other codec", "bits per voxel of ours (auto)"], series)
    };
    figure("Beside codecs that bound the error, too", &plot.html(), &reading)
}

#[cfg(test)]
mod tests {
    use supervol_format::VoxelType;

    use super::*;
    use crate::storage::codecs::Figures;

    fn built(codec: &'static str, edge: u64, wall_ms: f64) -> Built {
        let time = Spread::of(&[wall_ms, 1.5 * wall_ms, wall_ms]);
        Built { codec, edge, wall: time, cpu: time, peak_bytes: Some(3 << 20), container_bytes: edge.pow(3) / 2 }
    }

    fn measured() -> Storage {
        let figures = |codec, bytes| Figures { codec, bytes, decode_mb_s: 812.3, encode_mb_s: 200.0 };
        let rates = |share| Rates {
            name: "<survey>".into(),
            voxel_type: VoxelType::I16,
            share,
            voxels: 1000,
            codecs: vec![figures("raw", 2000), figures("auto", 500)],
        };
        let builds = vec![built("raw", 64, 2.0), built("raw", 128, 10.0), built("auto", 64, 4.0)];
        Storage { builds, rates: vec![rates(0.0), rates(0.01)], notes: Vec::new() }
    }

    #[test]
    fn every_build_and_every_volume_has_a_row() {
        let html = section(&measured(), Extent::Whole);
        assert_eq!(html.matches("<tr>").count(), 1 + 3 + 1 + 2, "{html}");
        assert_eq!(html.matches("<svg viewBox=\"0 0 560").count(), 4);
        // 128^3 bytes in 10 ms; the container has half of the bytes; 4 of 16 bits.
        for part in
            ["<td class=\"n\">210</td>", "0.01 (0.01 to 0.015)", "3.0 MiB", "<td class=\"n\">0.5</td>", "4; 812", "1 %"]
        {
            assert!(html.contains(part), "no {part}: {html}");
        }
        assert!(html.contains("&lt;survey&gt;") && !html.contains("<survey>") && html.contains("--memory 1024 MiB"));
        assert!(!section(&Storage::default(), Extent::Whole).contains("<table"));
    }

    #[test]
    fn a_summary_is_one_figure_and_the_least_of_the_tables() {
        let html = section(&measured(), Extent::Summary);
        // One codec at the largest size; lossless coding.
        assert_eq!((html.matches("<tr>").count(), html.matches("<figure>").count()), (1 + 1 + 1 + 1, 1), "{html}");
        assert!(html.contains("128\u{b3}") && !html.contains("1 %"), "{html}");
    }

    #[test]
    fn a_system_that_does_not_tell_memory_gets_a_dash() {
        let mut storage = measured();
        storage.builds.iter_mut().for_each(|built| built.peak_bytes = None);
        assert!(section(&storage, Extent::Whole).contains("<td class=\"n\">\u{2013}</td>"));
    }

    #[test]
    fn the_record_of_other_codecs_is_read_whole() {
        let lines = |codec: &str| BESIDE_OTHERS.lines().filter(|line| line.split(',').nth(3) == Some(codec)).count();
        for other in OTHERS {
            let pairs = pairs(BESIDE_OTHERS, other);
            assert!(pairs.len() == lines(other) && pairs.len() > 30, "{other}: {}", pairs.len());
            assert!(pairs.iter().all(|(a, b)| *a > 0.0 && *b > 0.0 && *a <= 64.0 && *b <= 64.0));
        }
        let record =
            "data,type,share,codec,bits\na,u8,0.0,ours auto,2.5\na,u8,0.0,SZ3 equal,3.5\nb,u8,0.0,SZ3 equal,1\n";
        assert_eq!(pairs(record, "SZ3 equal"), [(3.5, 2.5)], "of b there is nothing of ours");
    }
}
