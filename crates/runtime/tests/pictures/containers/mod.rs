//! Small containers in memory, and byte sources that are slow, fail, or count.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use supervol_format::codec::CodecChoice;
use supervol_format::container::header::Descriptor;
use supervol_format::container::manifest::{AxisName, Manifest, Source};
use supervol_format::container::seal::seal_brick;
use supervol_format::container::writer::ContainerWriter;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickKey, BrickLayout, ByteSource, Container, Dims, Lod, Pyramid, ValueRange, VoxelType};
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::frame::{render_cpu, streamer_for};
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::stop::Stop;
use supervol_runtime::stream::budget::{BrickBytes, HostPlan, MADE_LIMIT};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::support::Volume;

/// The bytes of a container of this volume. Coarser levels are means. Error bounds are the volume's range, which is a
/// safe choice.
pub fn container_bytes(volume: &Volume, core: u32) -> Vec<u8> {
    let mut levels = vec![volume.clone()];
    let mut factors = vec![];
    while let Some(last) = levels.last().filter(|l| l.dims.iter().any(|&n| n > core as usize)) {
        let f = last.dims.map(|n| if n > core as usize { 2 } else { 1 });
        factors.push(f.map(|v| v as u32));
        let coarser = last.coarser(f);
        levels.push(coarser);
    }
    let dims = Dims(volume.dims.map(|n| n as u64));
    let pyramid = Pyramid::new(dims, BrickLayout::new(core).unwrap(), &factors).unwrap();
    let absence = Absence { nodata: volume.nodata };
    let descriptor = Descriptor {
        voxel_type: volume.voxel_type,
        pyramid: pyramid.clone(),
        geometry: volume.geometry,
        scale: 1.0,
        offset: 0.0,
        absence,
        quantizer: None,
    };
    let mut writer = ContainerWriter::begin(Vec::new(), descriptor.clone()).unwrap();
    for (lod, level) in levels.iter().enumerate() {
        let error = if lod == 0 { 0.0 } else { volume.range().width() };
        for key in pyramid.keys_of(Lod(lod as u8)) {
            let beneath = pyramid
                .children(key)
                .fold(ValueRange::EMPTY, |range, child| range.union(writer.entry(child).unwrap().range_beneath));
            let voxels = stored_voxels(level, &pyramid, key);
            let brick = seal_brick(&descriptor, key, &voxels, CodecChoice::Smallest, beneath, error).unwrap();
            writer.append(brick).unwrap();
        }
    }
    writer.finish(&manifest(volume)).unwrap()
}

fn manifest(volume: &Volume) -> Manifest {
    let axis = || AxisName { name: String::new(), unit: String::new() };
    Manifest {
        tool: "test".into(),
        parameters: Default::default(),
        source: Source::computed("test"),
        space: String::new(),
        axes: [axis(), axis(), axis()],
        unit: String::new(),
        value_range: Some(volume.range()),
        present_voxels: 0,
        histogram: histogram(volume),
        percentiles: vec![],
        distribution: None,
        level_errors: vec![],
        survey: None,
        notes: vec![],
        others: std::collections::BTreeMap::default(),
    }
}

/// A histogram of 256 bins over the range of values.
fn histogram(volume: &Volume) -> Vec<u64> {
    let (range, mut counts) = (volume.range(), vec![0; 256]);
    for value in volume.values.iter().filter(|v| !v.is_nan()) {
        counts[((value - range.min) / range.width() * 256.0).min(255.0) as usize] += 1;
    }
    counts
}

fn stored_voxels(level: &Volume, pyramid: &Pyramid, key: BrickKey) -> Vec<u8> {
    let start = pyramid.core_box(key).start.map(|s| s as i64 - 2);
    let extent = pyramid.stored_extent(key);
    let mut bytes = Vec::new();
    for n in 0..extent.iter().product::<usize>() {
        let at = [n % extent[0], n / extent[0] % extent[1], n / (extent[0] * extent[1])];
        let [i, j, k]: [usize; 3] =
            std::array::from_fn(|a| (start[a] + at[a] as i64).clamp(0, level.dims[a] as i64 - 1) as usize);
        let v = level.values[i + level.dims[0] * (j + level.dims[1] * k)];
        let v = if v.is_nan() { level.nodata.unwrap_or(v) } else { v };
        match level.voxel_type {
            VoxelType::U8 => bytes.push(v as u8),
            VoxelType::U16 => bytes.extend((v as u16).to_le_bytes()),
            VoxelType::I16 => bytes.extend((v as i16).to_le_bytes()),
            VoxelType::F32 => bytes.extend((v as f32).to_le_bytes()),
            other => panic!("no test writes {other}"),
        }
    }
    bytes
}

/// Behaviour of a faulty source at a read.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    None,
    /// `EIO`.
    Error,
    /// A temporary network error.
    TimedOut,
    /// The source ends too early.
    Short,
}

type Rule = Box<dyn Fn(u64, Range<u64>) -> Fault + Send + Sync>;

/// A source that counts its reads. A rule over (number of the read, bytes read) makes it slow or fail.
pub struct Faulty {
    bytes: Vec<u8>,
    rule: Rule,
    delay: Duration,
    reads: AtomicU64,
}

impl Faulty {
    pub fn new(bytes: Vec<u8>, rule: impl Fn(u64, Range<u64>) -> Fault + Send + Sync + 'static) -> Arc<Self> {
        Arc::new(Self { bytes, rule: Box::new(rule), delay: Duration::ZERO, reads: AtomicU64::new(0) })
    }

    pub fn slow(bytes: Vec<u8>, delay: Duration) -> Arc<Self> {
        Arc::new(Self { bytes, rule: Box::new(|_, _| Fault::None), delay, reads: AtomicU64::new(0) })
    }

    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }
}

impl ByteSource for Faulty {
    fn len(&self) -> io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        std::thread::sleep(self.delay);
        let n = self.reads.fetch_add(1, Ordering::Relaxed);
        match (self.rule)(n, offset..offset + buffer.len() as u64) {
            Fault::None => self.bytes.read_exact_at(offset, buffer),
            Fault::Error => Err(io::Error::other("injected I/O error")),
            Fault::TimedOut => Err(io::ErrorKind::TimedOut.into()),
            Fault::Short => {
                let half = buffer.len() / 2;
                self.bytes.read_exact_at(offset, &mut buffer[..half])?;
                Err(io::ErrorKind::UnexpectedEof.into())
            }
        }
    }
}

/// A container of these bytes.
pub fn open(bytes: &[u8]) -> Arc<Container> {
    Arc::new(Container::from_source(Arc::new(bytes.to_vec())).unwrap())
}

/// A division of the host budget with room for exactly this many full bricks.
pub fn plan(container: &Container, scene: &ResolvedScene, cache_bricks: u64) -> HostPlan {
    let brick = BrickBytes::of(container);
    HostPlan {
        budget_bytes: u64::MAX,
        band_rows: scene.image_size[1],
        fixed_bytes: 0,
        made_bytes: MADE_LIMIT,
        state_limit: 1 << 20,
        in_flight_bytes: 4 * brick.record,
        cache_bytes: cache_bricks * brick.decoded,
    }
}

/// Renders with this plan and number of threads.
pub fn render_planned(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
    plan: HostPlan,
    threads: usize,
) -> Result<(Image, FrameStats), RenderError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let stop = Stop::at(options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms)));
        let mut streamer = streamer_for(container, scene, options, plan);
        let (image, stats) = render_cpu(scene, options, &mut streamer, plan, &stop)?;
        Ok((image, stats.with_failures(VolumeFacts::of(container).value_range)))
    })
}
