//! S41: reads that fail, are truncated, or return wrong bytes.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use glam::DVec3;
use supervol_format::cast::index;
use supervol_format::container::header;
use supervol_format::random::Random;
use supervol_format::{ByteSource, Container, VoxelType};
use supervol_runtime::stream::state::StateKind;
use supervol_scene::scene::ResolvedScene;
use supervol_sources::computed::Computed;

use super::session::{Frame, Session, Settings, pixels_lost, scene, translucent};
use super::sources::{Rule, Watched, pass};
use crate::context::{ChartError, Context};
use crate::fixtures::{marschner_lobb_at, point};
use crate::stability::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::volume::{Volume, build_options, image_size};

/// S41.
pub const READ_ERRORS: Regime = Regime {
    id: "S41",
    title: "Read errors",
    recipe: "A real container of 40^3 f32 voxels, a part of them absent, in bricks of 16, opened and drawn: once with each \
             of its reads failing; ending at, before and behind each section's border, before and after it was opened; \
             and with one bit flipped in its header, records, TOC, manifest or footer, as many flips in each.",
    x_label: "section (0 header, 1 records, 2 TOC, 3 manifest, 4 footer)",
    y_label: "flipped bits that changed what was read (%)",
    run: read_errors,
};

/// The container's bytes and its undamaged picture.
struct Subject {
    bytes: Arc<Vec<u8>>,
    /// Start offsets of header, records, TOC, manifest and footer; then the file length. Bytes.
    borders: [u64; 6],
    scene: ResolvedScene,
    whole: Frame,
    reads: u64,
}

/// Outcome of one damaged container.
#[derive(Debug, PartialEq, Eq)]
enum Fate {
    /// The container was not opened, and the error gives the reason.
    Refused,
    /// At least one brick is reported as failed, with its name.
    Named {
        /// Empty pixels that are not empty in the undamaged picture.
        pixels_lost: usize,
    },
    /// The picture is undamaged and nothing is reported: the damage was not read.
    Unharmed,
    /// The picture is wrong without a report, or a brick failed without a name.
    Wrong,
    /// The renderer panicked.
    Panicked,
}

/// Sums over damaged containers.
#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    cases: u64,
    refused: u64,
    named: u64,
    unharmed: u64,
    wrong: u64,
    panicked: u64,
    /// Pixels lost by damage that may cost one brick at most.
    pixels_lost: u64,
}

impl Tally {
    fn add(&mut self, fate: &Fate) {
        self.cases += 1;
        match fate {
            Fate::Refused => self.refused += 1,
            Fate::Named { .. } => self.named += 1,
            Fate::Unharmed => self.unharmed += 1,
            Fate::Wrong => self.wrong += 1,
            Fate::Panicked => self.panicked += 1,
        }
    }

    fn add_local(&mut self, fate: &Fate) {
        self.add(fate);
        if let Fate::Named { pixels_lost } = fate {
            self.pixels_lost += *pixels_lost as u64;
        }
    }
}

const SETTINGS: Settings = Settings {
    threads: 1,
    level: supervol_runtime::render::options::LevelChoice::Fixed(supervol_format::Lod::FINEST),
    host_memory_bytes: 256 << 20,
    cache_bytes: None,
    backend: supervol_runtime::render::options::Backend::Cpu,
    max_error: supervol_runtime::lod::by_error::ANY_ERROR,
};

impl Subject {
    fn new(context: &Context<'_>) -> Result<Self, ChartError> {
        // Half of the bricks along x have no data, and others have holes: absent voxels must not count as failed.
        let field = |v: [u64; 3]| {
            let p = point(v) / 19.5 - DVec3::ONE;
            if v[0] >= 32 || v[1] + v[2] < 9 { f64::NAN } else { 200.0 * marschner_lobb_at(p) }
        };
        let source = Computed::new([40; 3], VoxelType::F32, field);
        let volume = Volume::build(context, "read errors", &source, &build_options(16))?;
        let read = |source| ChartError::Write { path: volume.path.clone(), source };
        let bytes = Arc::new(std::fs::read(&volume.path).map_err(read)?);
        let s = volume.container.sections();
        let page = header::PAGE_BYTES as u64;
        let length = bytes.len() as u64;
        let borders = [0, page, s.toc_offset, s.manifest_offset, length - page, length];
        let scene = scene(&volume, &[volume.outside(), image_size(20, 16), translucent(volume.radius())])?;
        let watched = Arc::new(Watched::new(bytes.clone(), pass()).map_err(|e| ChartError::Broken(e.to_string()))?);
        let container = Arc::new(Container::from_source(watched.clone())?);
        let whole = Session::new(&container, SETTINGS)?.frame(&scene, None)?;
        if whole.stats.bricks_failed > 0 {
            return Err(ChartError::Broken("absent bricks are counted as failed".into()));
        }
        let reads = watched.reads();
        Ok(Self { bytes, borders, scene, whole, reads })
    }

    fn fate(&self, source: Result<Watched, io::Error>) -> Result<Fate, ChartError> {
        let source: Arc<dyn ByteSource> = Arc::new(source.map_err(|e| ChartError::Broken(e.to_string()))?);
        let drawn = catch_unwind(AssertUnwindSafe(|| -> Result<Option<(Session, Frame)>, ChartError> {
            let Ok(container) = Container::from_source(source) else { return Ok(None) };
            let mut session = Session::new(&Arc::new(container), SETTINGS)?;
            let frame = session.frame(&self.scene, None)?;
            Ok(Some((session, frame)))
        }));
        Ok(match drawn {
            Err(_) => Fate::Panicked,
            Ok(Err(error)) => return Err(error),
            Ok(Ok(None)) => Fate::Refused,
            Ok(Ok(Some((session, frame)))) => self.judge(&session, &frame),
        })
    }

    fn judge(&self, session: &Session, frame: &Frame) -> Fate {
        let failed = session.streamer().states().total(StateKind::Failed);
        let named = frame.stats.failures.iter().all(|f| f.brick.starts_with("brick (") && !f.reason.is_empty());
        match (failed, frame.stats.failures.is_empty()) {
            (0, true) if frame.image == self.whole.image => Fate::Unharmed,
            (1.., false) if named => Fate::Named { pixels_lost: pixels_lost(&frame.image, &self.whole.image) },
            _ => Fate::Wrong,
        }
    }

    fn watched(&self, rule: Rule) -> Result<Watched, io::Error> {
        Watched::new(self.bytes.clone(), rule)
    }
}

/// Each read of opening and drawing fails once.
fn each_read_fails(subject: &Subject) -> Result<Tally, ChartError> {
    let mut tally = Tally::default();
    for fail_at in 0..subject.reads {
        let rule: Rule =
            Box::new(move |n, _, _| if n == fail_at { Err(io::Error::other("injected EIO")) } else { Ok(()) });
        // A second read returns the right bytes.
        tally.add_local(&subject.fate(subject.watched(rule))?);
    }
    Ok(tally)
}

/// Truncation at each border, one byte before it and one after it; before opening and after opening.
fn truncations(subject: &Subject) -> Result<Tally, ChartError> {
    let mut tally = Tally::default();
    let length = subject.borders[5];
    for end in subject.borders.iter().flat_map(|&b| [b.saturating_sub(1), b, b + 1]).filter(|&end| end < length) {
        let fate = subject.fate(subject.watched(pass()).map(|w| w.with_length(end)))?;
        tally.add(&if fate == Fate::Unharmed { Fate::Wrong } else { fate });
        // Opening reads the footer. Bytes cut later are missed brick by brick.
        let footer = subject.borders[4];
        let rule: Rule = Box::new(move |_, offset, buffer| {
            let is_opening = offset >= footer || offset == 0;
            let is_beyond = offset + buffer.len() as u64 > end;
            if is_beyond && !is_opening { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(()) }
        });
        tally.add(&subject.fate(subject.watched(rule))?);
    }
    Ok(tally)
}

/// One flipped bit per case, the same number of cases in every section.
fn bit_flips(subject: &Subject, section: usize, cases: u64) -> Result<Tally, ChartError> {
    let mut random = Random::new(0x541 + section as u64);
    let mut tally = Tally::default();
    let (start, end) = (subject.borders[section], subject.borders[section + 1]);
    for _ in 0..cases {
        let (at, bit) = (start + random.below(end - start), random.below(8));
        let rule: Rule = Box::new(move |_, offset, buffer| {
            if let Some(byte) = at.checked_sub(offset).and_then(|i| buffer.get_mut(index(i))) {
                *byte ^= 1 << bit;
            }
            Ok(())
        });
        let fate = subject.fate(subject.watched(rule))?;
        // A flip in a record costs its brick. A flip in the TOC costs its page, which holds every brick here.
        if section == 1 { tally.add_local(&fate) } else { tally.add(&fate) }
    }
    Ok(tally)
}

fn read_errors(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let subject = Subject::new(context)?;
    let mut curve = Vec::new();
    let mut all = vec![each_read_fails(&subject)?, truncations(&subject)?];
    for section in 0..5 {
        (context.say)(&format!("S41: flipped bits in section {section}"));
        let flips = bit_flips(&subject, section, context.pick(2000, 60))?;
        let percent = |n: u64| 100.0 * n as f64 / flips.cases as f64;
        let x = section as f64;
        curve.push(CurvePoint::new("container refused", x, percent(flips.refused), None));
        curve.push(CurvePoint::new("brick named as failed", x, percent(flips.named), None));
        curve.push(CurvePoint::new("not read: picture unharmed", x, percent(flips.unharmed), None));
        curve.push(CurvePoint::new("accepted and wrong", x, percent(flips.wrong), Some(0.0)));
        all.push(flips);
    }
    let sum = |f: fn(&Tally) -> u64| all.iter().map(f).sum::<u64>();
    let gates = vec![
        Gate::at_most("damaged containers accepted with a wrong picture", sum(|t| t.wrong) as f64, 0.0),
        Gate::at_most("panics", sum(|t| t.panicked) as f64, 0.0),
        Gate::at_most("pixels lost to damage of single bricks", sum(|t| t.pixels_lost) as f64, 0.0),
    ];
    let note = format!(
        "{} cases: {} refused when opened, {} drawn with the failed bricks named, {} unharmed because the damaged place \
         was not read or a second read of it was whole. Half of the volume is absent, and is not counted as failed. A \
         damaged page of the table of contents costs all bricks it names.",
        sum(|t| t.cases),
        sum(|t| t.refused),
        sum(|t| t.named),
        sum(|t| t.unharmed)
    );
    Ok(Outcome { curve, gates, note })
}
