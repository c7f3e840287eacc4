//! Whether it is worth asking for a device.

/// Whether the machine may have a hardware GPU. On Linux its driver has a device file. Without one, no Vulkan driver is
/// started, which takes time and may print complaints on standard error.
#[must_use]
pub fn may_have_hardware() -> bool {
    const DEVICE_FILES: [&str; 4] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0"];
    !cfg!(target_os = "linux") || DEVICE_FILES.iter().any(|file| std::path::Path::new(file).exists())
}
