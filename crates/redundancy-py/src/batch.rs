//! Long calls: the GIL is released, Ctrl-C is seen between blocks, `threads=` picks the size of the pool.

use std::ops::Range;

use pyo3::prelude::*;
use redundancy_core::parallel::Pool;

use crate::callback::Watching;
use crate::convert::Threads;
use crate::error::to_py;

/// Calls `work` for consecutive ranges that cover `0..n`, each inside the chosen pool and without the GIL.
///
/// # Errors
/// `threads` of 0 or above 1024, a pool that cannot be started, an error of `work`, or a pending `KeyboardInterrupt`.
pub fn in_blocks<T: Into<Threads>>(
    py: Python<'_>,
    n: usize,
    block: usize,
    threads: Option<T>,
    work: impl FnMut(Range<usize>) -> redundancy_core::Result<()> + Send,
) -> PyResult<()> {
    in_blocks_watching(py, n, block, threads, &Watching::new(&[]), work)
}

/// As [`in_blocks`], where `work` evaluates functions of the user's, and ends with what they raise.
pub fn in_blocks_watching<T: Into<Threads>>(
    py: Python<'_>,
    n: usize,
    block: usize,
    threads: Option<T>,
    watching: &Watching,
    mut work: impl FnMut(Range<usize>) -> redundancy_core::Result<()> + Send,
) -> PyResult<()> {
    let pool = pool(threads)?;
    for start in (0..n).step_by(block.max(1)) {
        let range = start..n.min(start + block);
        let done = watching.detach(py, || pool.install(|| work(range)));
        watching.check(py)?;
        done.map_err(to_py)?;
        py.check_signals()?;
    }
    Ok(())
}

/// A pool of `threads`, or the one of the process.
///
/// # Errors
/// `threads` of 0 or above 1024, a pool that cannot be started.
pub fn pool<T: Into<Threads>>(threads: Option<T>) -> PyResult<Pool> {
    let count = threads.map(|threads| threads.into().count()).transpose()?;
    Pool::new(count).map_err(to_py)
}
