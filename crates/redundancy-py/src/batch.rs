//! Long calls: the GIL is released, Ctrl-C is seen between blocks, `threads=` picks the size of the pool.

use std::ops::Range;

use pyo3::prelude::*;
use redundancy_core::Error;

use crate::error::to_py;

/// More threads than any machine has cores; starting a million of them takes minutes.
const MAX_THREADS: usize = 1_024;

/// Calls `work` for consecutive ranges that cover `0..n`, each inside the chosen rayon pool and without the GIL.
///
/// # Errors
/// `threads` of 0 or above 1024, a pool that cannot be started, an error of `work`, or a pending `KeyboardInterrupt`.
pub fn in_blocks(
    py: Python<'_>,
    n: usize,
    block: usize,
    threads: Option<usize>,
    mut work: impl FnMut(Range<usize>) -> redundancy_core::Result<()> + Send,
) -> PyResult<()> {
    let pool = pool(threads)?;
    for start in (0..n).step_by(block.max(1)) {
        let range = start..n.min(start + block);
        py.detach(|| match &pool {
            Some(pool) => pool.install(|| work(range)),
            None => work(range),
        })
        .map_err(to_py)?;
        py.check_signals()?;
    }
    Ok(())
}

/// A pool of `threads`, or none for the current one.
///
/// # Errors
/// `threads` of 0 or above 1024, a pool that cannot be started.
pub fn pool(threads: Option<usize>) -> PyResult<Option<rayon::ThreadPool>> {
    match threads {
        None => Ok(None),
        Some(count) if !(1..=MAX_THREADS).contains(&count) => {
            let bound = if count == 0 { "at least 1".into() } else { format!("at most {MAX_THREADS}") };
            Err(to_py(Error::Invalid(format!("threads is {count}, it must be {bound}"))))
        }
        Some(count) => rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .build()
            .map(Some)
            .map_err(|error| to_py(Error::Invalid(format!("threads = {count}: {error}")))),
    }
}
