//! Whether it is worth asking for a device.

/// Whether a hardware GPU can be there at all. On Linux its driver shows as a device file; asking first spares machines
/// without one the start of every Vulkan driver, and that driver's complaints on standard error.
#[must_use]
pub fn may_have_hardware() -> bool {
    const DEVICE_FILES: [&str; 4] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0"];
    !cfg!(target_os = "linux") || DEVICE_FILES.iter().any(|file| std::path::Path::new(file).exists())
}
