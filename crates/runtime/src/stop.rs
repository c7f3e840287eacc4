//! Stop condition: a deadline or a cancel request.

use std::time::{Duration, Instant};

pub use supervol_format::canceller::Canceller;

/// Least duration of a step that has begun, even after the deadline, so that each step makes progress.
pub const LEAST_STEP: Duration = Duration::from_millis(1);

/// Handling of rays that still wait when the stop condition is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenDue {
    /// They pause, and continue when the same picture is drawn next.
    Pause,
    /// Resident coarser bricks complete the picture.
    Complete,
}

/// Condition under which work stops.
#[derive(Debug, Clone, Default)]
pub struct Stop {
    deadline: Option<Instant>,
    canceller: Option<Canceller>,
}

impl Stop {
    /// Never: stops only when all work is done.
    pub const NEVER: Self = Self { deadline: None, canceller: None };

    /// Stops at this time, if there is one.
    #[must_use]
    pub fn at(deadline: Option<Instant>) -> Self {
        Self { deadline, canceller: None }
    }

    /// Stops also when `canceller` is cancelled.
    #[must_use]
    pub fn or_by(self, canceller: Canceller) -> Self {
        Self { canceller: Some(canceller), ..self }
    }

    /// The time at which to stop.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// The same condition with another deadline, or none.
    #[must_use]
    pub fn instead_at(&self, deadline: Option<Instant>) -> Self {
        Self { deadline, ..self.clone() }
    }

    /// The same condition with its deadline no earlier than `time`, so that a step can make progress.
    #[must_use]
    pub fn not_before(&self, time: Instant) -> Self {
        self.instead_at(self.deadline.map(|deadline| deadline.max(time)))
    }

    /// Whether the deadline has passed.
    #[must_use]
    pub fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Whether work was cancelled, regardless of the time.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.canceller.as_ref().is_some_and(Canceller::is_cancelled)
    }

    /// Whether to stop now.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.is_cancelled() || self.is_late()
    }
}
