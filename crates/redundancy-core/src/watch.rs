//! Progress, time limit and cancellation of a long call.
//!
//! A long call takes a `&Watch`. It reports the share of its work that is done and asks from time to time whether to
//! go on; the caller reads the progress and cancels, from the call's own thread (an observer) or from any other.
//! Progress never goes backwards, also when a search is repeated.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::status::Status;

/// A time from which on work must end, counted from when it was made.
#[derive(Debug, Clone, Copy)]
pub struct Deadline {
    begin: Instant,
    limit: Option<Duration>,
}

impl Deadline {
    /// `seconds` from now. What is longer than a clock can count, or no number, is no limit.
    pub fn after(seconds: f64) -> Self {
        Self { begin: Instant::now(), limit: Duration::try_from_secs_f64(seconds).ok() }
    }

    /// No limit.
    pub fn never() -> Self {
        Self { begin: Instant::now(), limit: None }
    }

    /// Time since it was made.
    pub fn elapsed(&self) -> Duration {
        self.begin.elapsed()
    }

    /// The time limit, from when it was made.
    pub fn limit(&self) -> Option<Duration> {
        self.limit
    }

    /// Part of the time that is over, 0 without a limit; above 1 when it is past.
    pub fn share(&self) -> f64 {
        match self.limit {
            None => 0.0,
            Some(limit) if limit.is_zero() => f64::INFINITY,
            Some(limit) => self.elapsed().as_secs_f64() / limit.as_secs_f64(),
        }
    }

    /// Whether `share` of the time is over; never without a limit.
    pub fn passed(&self, share: f64) -> bool {
        self.limit.is_some_and(|limit| self.elapsed().as_secs_f64() > share * limit.as_secs_f64())
    }
}

impl Default for Deadline {
    fn default() -> Self {
        Self::never()
    }
}

/// A call was asked to stop, or met its time limit, before it was done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Interrupted {
    /// The caller asked to stop.
    Cancelled,
    /// The time limit was met.
    TimeLimit {
        /// The limit, s.
        seconds: f64,
    },
}

impl Interrupted {
    /// `Cancelled` or `TimeLimit`.
    pub fn status(self) -> Status {
        match self {
            Self::Cancelled => Status::Cancelled,
            Self::TimeLimit { .. } => Status::TimeLimit,
        }
    }
}

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cancelled => f.write_str("stopped by the caller"),
            Self::TimeLimit { seconds } => write!(f, "the time limit of {seconds} s was met"),
        }
    }
}

/// What is called with the progress on the thread that reports it; `false` cancels.
type Observer = Box<dyn Fn(&Watch) -> bool + Send + Sync>;

/// A look into a long call, and the way to stop it.
///
/// ```
/// use redundancy_core::{Interrupted, Watch};
/// let watch = Watch::default().with_observer(|watch| watch.share() < 0.5);
/// let done = (0..10).take_while(|k| watch.report(f64::from(*k) / 10.0).is_ok()).count();
/// assert_eq!((done, watch.share(), watch.interrupted()), (5, 0.5, Some(Interrupted::Cancelled)));
/// let late = Watch::default().with_time_limit(0.0)?;
/// assert_eq!(late.report(0.1), Err(Interrupted::TimeLimit { seconds: 0.0 }));
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Default)]
pub struct Watch {
    cancelled: AtomicBool,
    /// Bits of a number that is not negative: such numbers are ordered as their bits are.
    share: AtomicU64,
    speed: AtomicU64,
    deadline: Deadline,
    observer: Option<Observer>,
}

impl Watch {
    /// The same with a time limit of `seconds`, counted from now; infinite is none.
    ///
    /// # Errors
    /// A limit that is negative or no number.
    pub fn with_time_limit(mut self, seconds: f64) -> Result<Self> {
        if seconds.is_nan() || seconds < 0.0 {
            let bound = ">= 0 s".into();
            return Err(Error::OutOfRange { what: "time_limit".into(), value: seconds, bound });
        }
        self.deadline = Deadline::after(seconds);
        Ok(self)
    }

    /// The same with a function that is called at each report, on the thread that reports; `false` cancels.
    #[must_use]
    pub fn with_observer(mut self, observer: impl Fn(&Self) -> bool + Send + Sync + 'static) -> Self {
        self.observer = Some(Box::new(observer));
        self
    }

    /// Asks the call to end with its best result so far.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether the call was asked to end.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// The time limit.
    pub fn deadline(&self) -> &Deadline {
        &self.deadline
    }

    /// Why the call must end now, or `None` to go on.
    pub fn interrupted(&self) -> Option<Interrupted> {
        if self.is_cancelled() {
            return Some(Interrupted::Cancelled);
        }
        let limit = self.deadline.limit().filter(|_| self.deadline.passed(1.0))?;
        Some(Interrupted::TimeLimit { seconds: limit.as_secs_f64() })
    }

    /// Largest share of the work that was reported, in `[0, 1]`.
    pub fn share(&self) -> f64 {
        f64::from_bits(self.share.load(Ordering::Relaxed))
    }

    /// Highest speed that was reported by a search for speed, m/s, not verified yet; `None` before the first.
    pub fn speed(&self) -> Option<f64> {
        let speed = f64::from_bits(self.speed.load(Ordering::Relaxed));
        (speed > 0.0).then_some(speed)
    }

    /// Notes that `share` of the work is done. A smaller share than before changes nothing.
    ///
    /// # Errors
    /// The call must end now.
    pub fn report(&self, share: f64) -> std::result::Result<(), Interrupted> {
        if share > 0.0 {
            self.share.fetch_max(share.min(1.0).to_bits(), Ordering::Relaxed);
        }
        if let Some(observer) = &self.observer
            && !observer(self)
        {
            self.cancel();
        }
        self.interrupted().map_or(Ok(()), Err)
    }

    /// Notes a speed (m/s) that was found.
    pub fn report_speed(&self, speed: f64) {
        if speed > 0.0 {
            self.speed.fetch_max(speed.to_bits(), Ordering::Relaxed);
        }
    }

    /// The progress of a part of the work: shares of it are counted from `from` to `to` of the whole.
    pub fn part(&self, from: f64, to: f64) -> WatchPart<'_> {
        WatchPart { watch: self, from, to }
    }
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Watch")
            .field("share", &self.share())
            .field("cancelled", &self.is_cancelled())
            .field("deadline", &self.deadline)
            .finish_non_exhaustive()
    }
}

/// A part of the work of a [`Watch`].
#[derive(Debug, Clone, Copy)]
pub struct WatchPart<'a> {
    watch: &'a Watch,
    from: f64,
    to: f64,
}

impl WatchPart<'_> {
    /// Notes that `share` of this part is done.
    ///
    /// # Errors
    /// The call must end now.
    pub fn report(&self, share: f64) -> std::result::Result<(), Interrupted> {
        self.watch.report(self.from + (self.to - self.from) * share.clamp(0.0, 1.0))
    }

    /// Why the call must end now, or `None` to go on.
    pub fn interrupted(&self) -> Option<Interrupted> {
        self.watch.interrupted()
    }

    /// A part of this part.
    pub fn part(&self, from: f64, to: f64) -> Self {
        let at = |share: f64| self.from + (self.to - self.from) * share;
        Self { watch: self.watch, from: at(from), to: at(to) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_never_goes_backwards() {
        let watch = Watch::default();
        for share in [0.3, 0.1, f64::NAN, -1.0] {
            assert!(watch.report(share).is_ok());
            assert!((watch.share() - 0.3).abs() < 1e-15);
        }
        assert!(watch.part(0.4, 0.8).part(0.25, 0.75).report(0.5).is_ok());
        assert!((watch.share() - 0.6).abs() < 1e-15);
        assert!(watch.report(7.0).is_ok());
        assert!((watch.share() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_cancelled_call_says_so_before_a_late_one() {
        let watch = Watch::default().with_time_limit(0.0).unwrap();
        std::hint::black_box((0..1000).sum::<u64>());
        assert_eq!(watch.interrupted().map(Interrupted::status), Some(Status::TimeLimit));
        watch.cancel();
        assert_eq!(watch.report(0.5), Err(Interrupted::Cancelled));
        assert_eq!(watch.interrupted().map(Interrupted::status), Some(Status::Cancelled));
        assert_eq!(Watch::default().with_time_limit(f64::INFINITY).unwrap().interrupted(), None);
        assert!(Watch::default().with_time_limit(f64::NAN).is_err());
    }
}
