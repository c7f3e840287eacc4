//! The GPU device: choice of the adapter, its limits, and wgpu's errors as [`GpuError`].
//!
//! Adapters are preferred in the order discrete, integrated, virtual, software; `SUPERVOL_ADAPTER` selects another by a
//! part of its name (any case). Core WebGPU suffices and no feature is requested; software adapters need one storage
//! texture more. Limits are requested as far as the adapter has them, but never beyond what this backend can use. Every
//! allocation runs inside error scopes ([`GpuDevice::checked`]). After a device loss every call returns
//! [`GpuError::DeviceLost`], and the caller must make a new device and a new renderer.

use std::pin::pin;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::task::{Context, Poll, Waker};

use supervol_format::cast::narrow;

use super::pipelines::{Pipelines, Variant};
use super::shaders::TexelAccess;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::{SHARED_MEMORY, TEXTURE_LIMIT};
use crate::stream::counters::DeviceCounters;

/// Environment variable that names the adapter: any part of its name, in any case.
pub const ADAPTER_VARIABLE: &str = "SUPERVOL_ADAPTER";

/// Most polls of a future before it counts as stuck: natively wgpu's futures are ready at once or after one poll.
const FUTURE_POLL_LIMIT: usize = 1 << 20;

/// Default memory to use on a discrete card, bytes.
const CARD_MEMORY: u64 = 1 << 30;

/// Most variants of the pipelines that are kept: modes, with and without shading, of either texel access.
const VARIANT_LIMIT: usize = 20;

/// Storage textures of a shader: the cache's and the transfer function's light table. WebGPU guarantees one less.
#[expect(clippy::cast_possible_truncation, reason = "a small constant")]
const STORAGE_TEXTURES: u32 = TEXTURE_LIMIT as u32 + 1;

/// Pipelines, and the parameters that they were compiled for.
type KeptPipelines = (Variant, TexelAccess, Arc<Pipelines>);

/// wgpu's flags for this build, without debug information in shaders: for each statement naga counts the lines of the source
/// from its start, which takes longer than the translation. `WGPU_DEBUG=1` adds debug information.
fn instance_flags() -> wgpu::InstanceFlags {
    wgpu::InstanceFlags::from_build_config().difference(wgpu::InstanceFlags::DEBUG).with_env()
}

/// One opened GPU: device, queue and limits. A clone is the same device.
#[derive(Debug, Clone)]
pub struct GpuDevice {
    /// The logical device.
    pub device: wgpu::Device,
    /// Its only queue; submissions and bytes are counted.
    queue: wgpu::Queue,
    traffic: Arc<Mutex<DeviceCounters>>,
    info: wgpu::AdapterInfo,
    limits: wgpu::Limits,
    texels: TexelAccess,
    deals_as: wgpu::DeviceType,
    lost: Arc<OnceLock<String>>,
    uncaptured: Arc<Mutex<Vec<GpuError>>>,
    pipelines: Arc<Mutex<Vec<KeptPipelines>>>,
}

impl GpuDevice {
    /// Opens the preferred adapter, or the one that `SUPERVOL_ADAPTER` names.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] if there is none, or none of that name. [`GpuError::TooSmall`] if it opens but cannot
    /// run a compute shader on the textures that bricks need.
    pub fn open() -> Result<Self, GpuError> {
        Self::open_named(std::env::var(ADAPTER_VARIABLE).ok().as_deref())
    }

    /// Opens the preferred adapter among those whose name contains `wanted`.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_named(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            flags: instance_flags(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let mut adapters = block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let names = adapters.iter().map(|a| a.get_info().name).collect::<Vec<_>>().join(", ");
        if let Some(wanted) = wanted {
            let wanted = wanted.to_lowercase();
            adapters.retain(|a| a.get_info().name.to_lowercase().contains(&wanted));
        }
        adapters.sort_by_key(|a| preference(a.get_info().device_type));
        let adapter = adapters.into_iter().next().ok_or_else(|| GpuError::NoAdapter {
            reason: match wanted {
                Some(w) => format!("none of [{names}] has a name containing {w:?} ({ADAPTER_VARIABLE})"),
                None => "no driver offers one".to_owned(),
            },
        })?;
        Self::from_adapter(&adapter)
    }

    fn from_adapter(adapter: &wgpu::Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let too_small = |reason: String| GpuError::TooSmall { adapter: info.name.clone(), reason };
        let limits = wanted_limits(&adapter.limits());
        if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
            return Err(too_small("it has no compute shaders".to_owned()));
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("supervol"),
            required_features: wgpu::Features::empty(),
            required_limits: limits.clone(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        };
        let (device, queue) =
            block_on(adapter.request_device(&descriptor)).map_err(|error| too_small(error.to_string()))?;

        let lost = Arc::new(OnceLock::new());
        let remember = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            // Only the first loss is kept; a second message about the same device adds nothing.
            let _ = remember.set(format!("{reason:?}: {message}"));
        });
        let uncaptured = Arc::new(Mutex::new(Vec::new()));
        let collect = Arc::clone(&uncaptured);
        device.on_uncaptured_error(Arc::new(move |error| {
            if let Ok(mut errors) = collect.lock() {
                keep_first_of_kind(&mut errors, from_wgpu(error, "a pass"));
            }
        }));
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        let has_stored = limits.max_storage_textures_per_shader_stage >= STORAGE_TEXTURES;
        let texels = if is_software && has_stored { TexelAccess::Stored } else { TexelAccess::Sampled };
        Ok(Self {
            device,
            queue,
            traffic: Arc::default(),
            deals_as: info.device_type,
            info,
            limits,
            texels,
            lost,
            uncaptured,
            pipelines: Arc::default(),
        })
    }

    /// Destroys the device, as a driver does that resets it: every later call returns [`GpuError::DeviceLost`].
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// The adapter's name and kind, for statistics and messages.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{} ({:?}, {:?})", self.info.name, self.info.device_type, self.info.backend)
    }

    /// Whether the adapter is software.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// The way its shaders read textures.
    #[must_use]
    pub fn texels(&self) -> TexelAccess {
        self.texels
    }

    /// The same device with another way of reading textures; it must have enough storage textures.
    #[must_use]
    pub fn with_texels(self, texels: TexelAccess) -> Self {
        Self { texels, ..self }
    }

    /// Default memory to use, bytes. Cards have their own memory, and a survey of 512^3 voxels fits; other adapters
    /// share the CPU's.
    #[must_use]
    pub fn default_memory(&self) -> u64 {
        if self.info.device_type == wgpu::DeviceType::DiscreteGpu { CARD_MEMORY } else { SHARED_MEMORY }
    }

    /// The kind of adapter that work is scheduled for: normally its own.
    #[must_use]
    pub fn deals_as(&self) -> wgpu::DeviceType {
        self.deals_as
    }

    /// Whether work is scheduled for a software adapter.
    #[must_use]
    pub fn deals_as_software(&self) -> bool {
        self.deals_as == wgpu::DeviceType::Cpu
    }

    /// The same device with work scheduled as for a card: for tests without a card. It is slower.
    #[must_use]
    pub fn dealt_as_card(self) -> Self {
        Self { deals_as: wgpu::DeviceType::DiscreteGpu, ..self.with_texels(TexelAccess::Sampled) }
    }

    /// The compute pipelines of a variant: compiled once per device; the last twenty are kept.
    ///
    /// # Errors
    /// If the driver refuses one.
    pub fn pipelines(&self, variant: Variant) -> Result<Arc<Pipelines>, GpuError> {
        self.alive()?;
        let mut kept = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let is_wanted = |(other, texels, _): &&KeptPipelines| (*other, *texels) == (variant, self.texels);
        if let Some((.., pipelines)) = kept.iter().find(is_wanted) {
            return Ok(Arc::clone(pipelines));
        }
        let pipelines = Arc::new(Pipelines::new(self, variant)?);
        if kept.len() == VARIANT_LIMIT {
            kept.remove(0);
        }
        kept.push((variant, self.texels, Arc::clone(&pipelines)));
        Ok(pipelines)
    }

    /// The granted limits.
    #[must_use]
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// Runs `make` inside error scopes; its result counts only if no scope caught anything.
    ///
    /// # Errors
    /// Out of memory, a refused object, or a lost device; `doing` goes into the message.
    pub fn checked<T>(&self, doing: &str, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        self.alive()?;
        let scopes = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory]
            .map(|filter| self.device.push_error_scope(filter));
        let made = make();
        // The scopes form a stack: the last one pushed is popped first.
        let mut caught = None;
        for scope in scopes.into_iter().rev() {
            caught = caught.or(block_on(scope.pop()));
        }
        self.alive()?;
        match caught {
            Some(error) => Err(from_wgpu(error, doing)),
            None => Ok(made),
        }
    }

    /// A buffer of `bytes` zeros that can also be copied to and from; at least 4 bytes.
    ///
    /// # Errors
    /// As [`Self::checked`].
    pub fn buffer(&self, doing: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let size = bytes.next_multiple_of(4).max(4);
        self.checked(doing, || {
            let label = Some(doing);
            self.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
        })
    }

    /// A buffer for reading back.
    ///
    /// # Errors
    /// As [`Self::checked`].
    pub fn read_buffer(&self, doing: &str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let size = bytes.next_multiple_of(4).max(4);
        self.checked(doing, || {
            let label = Some(doing);
            self.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
        })
    }

    /// Counters of submits, bytes written and bytes read back since the device was opened; all other fields are zero.
    #[must_use]
    pub fn traffic(&self) -> DeviceCounters {
        *self.traffic.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, more: &DeviceCounters) {
        self.traffic.lock().unwrap_or_else(PoisonError::into_inner).add(more);
    }

    fn count_written(&self, bytes: &[u8]) {
        self.count(&DeviceCounters { written_bytes: bytes.len() as u64, ..DeviceCounters::default() });
    }

    /// Submits encoded commands, and all earlier writes.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) -> wgpu::SubmissionIndex {
        self.count(&DeviceCounters { submits: 1, ..DeviceCounters::default() });
        self.queue.submit([encoder.finish()])
    }

    /// Writes to a buffer, before everything that is submitted later.
    pub fn write_buffer(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        self.count_written(bytes);
        self.queue.write_buffer(buffer, offset, bytes);
    }

    /// Writes to a texture likewise; `bytes` are rows without gaps.
    pub fn write_texture(&self, place: wgpu::TexelCopyTextureInfo<'_>, bytes: &[u8], size: wgpu::Extent3d) {
        self.count_written(bytes);
        let rows = size.height * size.depth_or_array_layers;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(narrow::<u32>(bytes.len()) / rows),
            rows_per_image: Some(size.height),
        };
        self.queue.write_texture(place, bytes, layout, size);
    }

    /// Waits until everything written and submitted is done.
    ///
    /// # Errors
    /// As [`Self::wait`].
    pub fn flush(&self) -> Result<(), GpuError> {
        self.count(&DeviceCounters { submits: 1, ..DeviceCounters::default() });
        self.queue.submit([]);
        self.wait()
    }

    /// Waits for all work, then passes the first `bytes` of a read-back buffer to `read`.
    ///
    /// # Errors
    /// A lost device, or a failed mapping.
    pub fn read<T>(&self, buffer: &wgpu::Buffer, bytes: u64, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuError> {
        self.read_after(None, buffer, bytes, read)
    }

    /// The same after this submission, whatever was submitted later.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_after<T>(
        &self,
        submission: Option<wgpu::SubmissionIndex>,
        buffer: &wgpu::Buffer,
        bytes: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, GpuError> {
        let failed = |message: String| GpuError::Refused { doing: "a read-back".to_owned(), message };
        let outcome = Arc::new(OnceLock::new());
        let tell = Arc::clone(&outcome);
        buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            // Called once: the cell is empty.
            let _ = tell.set(result.map_err(|error| error.to_string()));
        });
        let waited = self.wait_for(submission);
        if !matches!((&waited, outcome.get()), (Ok(()), Some(Ok(())))) {
            // Waiting reports a lost device.
            self.wait()?;
        }
        waited?;
        match outcome.get() {
            Some(Ok(())) => {}
            Some(Err(message)) => return Err(failed(message.clone())),
            None => return Err(failed("the driver never answered".to_owned())),
        }
        self.count(&DeviceCounters { read_bytes: bytes, ..DeviceCounters::default() });
        let view = buffer.get_mapped_range(..bytes).map_err(|error| failed(error.to_string()))?;
        let result = read(&view);
        drop(view);
        buffer.unmap();
        Ok(result)
    }

    /// Waits until everything submitted has run.
    ///
    /// # Errors
    /// A lost device, or an error of a submission outside any scope (each kind once).
    pub fn wait(&self) -> Result<(), GpuError> {
        self.wait_for(None)
    }

    fn wait_for(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::Wait { submission_index, timeout: None });
        self.alive()?;
        polled.map_err(|error| GpuError::Refused { doing: "a wait".to_owned(), message: error.to_string() })?;
        let first = self.uncaptured.lock().ok().and_then(|mut errors| errors.drain(..).next());
        first.map_or(Ok(()), Err)
    }

    /// Whether the device still exists.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`] if it does not.
    pub fn alive(&self) -> Result<(), GpuError> {
        match self.lost.get() {
            Some(message) => Err(GpuError::DeviceLost { message: message.clone() }),
            None => Ok(()),
        }
    }
}

/// Order of choice: lower is better.
fn preference(kind: wgpu::DeviceType) -> u32 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// WebGPU's guaranteed limits, raised as far as the adapter allows: the four sizes that decide how much fits, and the
/// textures that are read most.
fn wanted_limits(adapter: &wgpu::Limits) -> wgpu::Limits {
    let mut limits = wgpu::Limits::defaults();
    limits.max_storage_textures_per_shader_stage = adapter
        .max_storage_textures_per_shader_stage
        .min(STORAGE_TEXTURES)
        .max(limits.max_storage_textures_per_shader_stage);
    limits.max_texture_dimension_3d = adapter.max_texture_dimension_3d;
    limits.max_buffer_size = adapter.max_buffer_size;
    limits.max_storage_buffer_binding_size = adapter.max_storage_buffer_binding_size;
    limits.max_compute_workgroups_per_dimension = adapter.max_compute_workgroups_per_dimension;
    limits
}

fn from_wgpu(error: wgpu::Error, doing: &str) -> GpuError {
    let doing = doing.to_owned();
    match error {
        wgpu::Error::OutOfMemory { source } => GpuError::OutOfMemory { doing, message: source.to_string() },
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            GpuError::Refused { doing, message: description }
        }
    }
}

/// Errors are reported once per kind, not once per frame.
fn keep_first_of_kind(errors: &mut Vec<GpuError>, error: GpuError) {
    if !errors.iter().any(|e| std::mem::discriminant(e) == std::mem::discriminant(&error)) {
        errors.push(error);
    }
}

/// Runs one of wgpu's futures to its end; natively they are ready almost at once.
fn block_on<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    for _ in 0..FUTURE_POLL_LIMIT {
        if let Poll::Ready(output) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return output;
        }
        std::thread::yield_now();
    }
    panic!("a wgpu future was still pending after {FUTURE_POLL_LIMIT} polls");
}
