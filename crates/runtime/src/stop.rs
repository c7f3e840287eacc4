//! When work stops that can be given up: at a time, or when somebody says so.

use std::time::{Duration, Instant};

pub use supervol_format::canceller::Canceller;

/// What is begun before the time is up goes on so long at least: however short the steps are, each comes some way.
pub const LEAST_STEP: Duration = Duration::from_millis(1);

/// When work stops.
#[derive(Debug, Clone, Default)]
pub struct Stop {
    deadline: Option<Instant>,
    canceller: Option<Canceller>,
}

impl Stop {
    /// When all is done.
    pub const NEVER: Self = Self { deadline: None, canceller: None };

    /// At this time, if there is one.
    #[must_use]
    pub fn at(deadline: Option<Instant>) -> Self {
        Self { deadline, canceller: None }
    }

    /// Also when this says so.
    #[must_use]
    pub fn or_by(self, canceller: Canceller) -> Self {
        Self { canceller: Some(canceller), ..self }
    }

    /// The time at which to stop.
    #[must_use]
    pub fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// The same with another time, or none.
    #[must_use]
    pub fn instead_at(&self, deadline: Option<Instant>) -> Self {
        Self { deadline, ..self.clone() }
    }

    /// The same, but its time is not up before this: what is begun comes some way.
    #[must_use]
    pub fn not_before(&self, time: Instant) -> Self {
        self.instead_at(self.deadline.map(|deadline| deadline.max(time)))
    }

    /// Whether the time is up.
    #[must_use]
    pub fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Whether somebody wants the work to stop, whatever the time.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.canceller.as_ref().is_some_and(Canceller::is_cancelled)
    }

    /// Whether to stop.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.is_cancelled() || self.is_late()
    }
}
