//! Loops over voxels, compiled once more for the wider vectors that most processors have.

/// Something to do with whatever instructions the processor has: `#[inline(always)]` all the way down.
pub trait Vectorized {
    /// What comes of it.
    type Output;
    /// Does it.
    fn run(self) -> Self::Output;
}

/// Does it with the processor's instructions.
pub fn vectorized<T: Vectorized>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi2") && is_x86_feature_detected!("lzcnt") {
        // SAFETY: the processor has what the function is compiled for.
        return unsafe { with_avx2(task) };
    }
    task.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi2,lzcnt")]
fn with_avx2<T: Vectorized>(task: T) -> T::Output {
    task.run()
}
