//! Loops over voxels, compiled a second time for the wider vectors (AVX2) of most processors.

/// Task that is compiled for several instruction sets: every function it calls must be `#[inline(always)]`.
pub trait Vectorized {
    /// Result of the task.
    type Output;
    /// Runs the task.
    fn run(self) -> Self::Output;
}

/// Runs a task with the widest instruction set that both this function and the processor support.
pub fn vectorized<T: Vectorized>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi2") && is_x86_feature_detected!("lzcnt") {
        // SAFETY: the processor has the features that the function is compiled for.
        return unsafe { with_avx2(task) };
    }
    task.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi2,lzcnt")]
fn with_avx2<T: Vectorized>(task: T) -> T::Output {
    task.run()
}
