//! The device in builds without the feature `gpu`: there is none.

use std::convert::Infallible;

use super::error::GpuError;

/// Environment variable that names the adapter, in builds that have one.
pub const ADAPTER_VARIABLE: &str = "SUPERVOL_ADAPTER";

/// A device: no value of this type exists. The field is private to this crate, so that callers compile without warnings about code
/// that cannot be reached.
#[derive(Debug, Clone)]
pub struct GpuDevice(pub(crate) Infallible);

impl GpuDevice {
    /// Opens no device.
    ///
    /// # Errors
    /// Always.
    pub fn open() -> Result<Self, GpuError> {
        Err(GpuError::NotBuilt)
    }

    /// Opens no device, whatever its name.
    ///
    /// # Errors
    /// Always.
    pub fn open_named(_wanted: Option<&str>) -> Result<Self, GpuError> {
        Err(GpuError::NotBuilt)
    }

    /// Destroys the device.
    pub fn destroy(&self) {
        match self.0 {}
    }

    /// Name and kind of the adapter.
    #[must_use]
    pub fn name(&self) -> String {
        match self.0 {}
    }

    /// Whether the adapter is a processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        match self.0 {}
    }

    /// Whether work is dealt out as for software.
    #[must_use]
    pub fn deals_as_software(&self) -> bool {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_was_not_built_says_so() {
        let message = GpuDevice::open().expect_err("no value exists").to_string();
        assert!(message.contains("no GPU backend") && message.contains("CPU backend"), "{message}");
    }
}
