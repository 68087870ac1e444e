//! Work on several threads: the only file that knows `rayon`.
//!
//! `rayon`'s global pool does not survive a `fork`: the child inherits its data and none of its threads, and waits forever.
//! Here every process has a pool of its own, found by the process id, which starts with the first parallel call. Between
//! processes nothing is locked: the pool is published with one atomic pointer, and a pool inherited from the parent is
//! neither used nor dropped.
//!
//! Everything parallel in this crate goes through [`install`], which is what the iterators of [`prelude`] do at their end:
//! code outside of a pool runs in that of its process, code inside of a pool (a [`Pool`] of fewer threads, or a pool of the
//! caller's own) stays there. The size of the process's pool is the number of cores, or `RAYON_NUM_THREADS`.
//!
//! Without the feature `parallel` the same iterators run on the calling thread, with the same results.
//!
//! ```
//! use redundancy_core::parallel::{Pool, prelude::*};
//! let squares = || (0..5).into_par_iter().map(|i| i * i).collect::<Vec<usize>>();
//! assert_eq!(squares(), [0, 1, 4, 9, 16]);
//! assert_eq!(Pool::new(Some(2))?.install(squares), squares());
//! # Ok::<(), redundancy_core::Error>(())
//! ```

pub use imp::{Par, Pool, install};

/// The parallel iterators over slices, vectors and ranges: `use crate::parallel::prelude::*`.
pub mod prelude {
    pub use super::{IntoPar, Par, ParSlice};
}

/// Parallel iterators over the items and the pieces of a slice.
pub trait ParSlice<T> {
    /// Over shared references to the items.
    fn par_iter(&self) -> Par<imp::Iter<'_, T>>
    where
        T: Sync;
    /// Over exclusive references to the items.
    fn par_iter_mut(&mut self) -> Par<imp::IterMut<'_, T>>
    where
        T: Send;
    /// Over consecutive pieces of `size` items; a shorter rest is left out. `size` is not 0.
    fn par_chunks_exact(&self, size: usize) -> Par<imp::ChunksExact<'_, T>>
    where
        T: Sync;
    /// The same with exclusive references.
    fn par_chunks_exact_mut(&mut self, size: usize) -> Par<imp::ChunksExactMut<'_, T>>
    where
        T: Send;
    /// Over consecutive pieces of `size` items, the last one may be shorter, with exclusive references. `size` is not 0.
    fn par_chunks_mut(&mut self, size: usize) -> Par<imp::ChunksMut<'_, T>>
    where
        T: Send;
}

/// What becomes a parallel iterator over its items: vectors, ranges of `usize`, slices.
pub trait IntoPar {
    /// The iterator inside of [`Par`].
    type Inner;

    /// The parallel iterator.
    fn into_par_iter(self) -> Par<Self::Inner>;
}

impl<I> IntoPar for Par<I> {
    type Inner = I;

    fn into_par_iter(self) -> Self {
        self
    }
}

impl<'a, T: Sync> IntoPar for &'a [T] {
    type Inner = imp::Iter<'a, T>;

    fn into_par_iter(self) -> Par<Self::Inner> {
        self.par_iter()
    }
}

impl<'a, T: Send> IntoPar for &'a mut [T] {
    type Inner = imp::IterMut<'a, T>;

    fn into_par_iter(self) -> Par<Self::Inner> {
        self.par_iter_mut()
    }
}

#[cfg(feature = "parallel")]
mod imp {
    use std::cell::Cell;
    use std::mem::ManuallyDrop;
    use std::ops::Range;
    use std::panic::resume_unwind;
    use std::ptr;
    use std::sync::atomic::{AtomicPtr, Ordering};

    use rayon::iter::{
        self, FromParallelIterator, IndexedParallelIterator, IntoParallelIterator, ParallelExtend,
        ParallelIterator,
    };
    pub use rayon::slice::{ChunksExact, ChunksExactMut, ChunksMut, Iter, IterMut};
    use rayon::slice::{ParallelSlice, ParallelSliceMut};

    use super::{IntoPar, ParSlice};
    use crate::error::{Error, Result};

    thread_local! {
        /// On a thread of one of our pools the process that started it, otherwise 0.
        static STARTED_BY: Cell<u32> = const { Cell::new(0) };
    }

    /// Threads and the process that they run in.
    struct Owned {
        process: u32,
        pool: rayon::ThreadPool,
    }

    impl Owned {
        /// `threads` of 0 leaves the number to rayon.
        fn start(threads: usize) -> std::result::Result<Self, rayon::ThreadPoolBuildError> {
            let process = std::process::id();
            let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = builder.start_handler(move |_| STARTED_BY.set(process)).build()?;
            Ok(Self { process, pool })
        }

        fn is_inherited(&self) -> bool {
            self.process != std::process::id()
        }
    }

    /// The pool of the process. A pointer to a leaked box: after a fork it still shows the pool of the parent, which is
    /// then replaced and never touched again.
    static POOL: AtomicPtr<Owned> = AtomicPtr::new(ptr::null_mut());

    /// The pool of this process; none where its threads cannot be started.
    fn own() -> Option<&'static Owned> {
        let mut seen = POOL.load(Ordering::Acquire);
        let mut started: Option<Box<Owned>> = None;
        loop {
            // SAFETY: the pointer is null or comes from `Box::into_raw` below and is never freed.
            if let Some(pool) = unsafe { seen.as_ref() }.filter(|pool| !pool.is_inherited()) {
                return Some(pool);
            }
            let fresh = match started.take() {
                Some(fresh) => fresh,
                None => Box::new(Owned::start(0).ok()?),
            };
            let fresh = Box::into_raw(fresh);
            match POOL.compare_exchange(seen, fresh, Ordering::AcqRel, Ordering::Acquire) {
                // SAFETY: as above.
                Ok(_) => return unsafe { fresh.as_ref() },
                Err(other) => {
                    // Another thread was first. SAFETY: `fresh` was published to nobody.
                    started = Some(unsafe { Box::from_raw(fresh) });
                    seen = other;
                }
            }
        }
    }

    /// Where the calling thread stands.
    enum Standing {
        /// On a thread of a pool: one of ours, or the caller's own.
        InPool,
        /// On the copy of a pool's thread in a child that was forked from there.
        InCopy,
        /// On a thread of no pool.
        Outside,
    }

    fn standing() -> Standing {
        if rayon::current_thread_index().is_none() {
            return Standing::Outside;
        }
        let process = STARTED_BY.get();
        if process == 0 || process == std::process::id() { Standing::InPool } else { Standing::InCopy }
    }

    /// Runs `work` where parallel iterators use the pool of this process, and waits for it.
    ///
    /// On a thread of a pool `work` is simply called. Where no thread can be started it runs on the calling thread.
    pub fn install<R: Send>(work: impl FnOnce() -> R + Send) -> R {
        match standing() {
            Standing::InPool => work(),
            Standing::InCopy => on_fresh_thread(|| install(work)),
            Standing::Outside => match own() {
                Some(own) => own.pool.install(work),
                None => {
                    // From now on the calling thread is a pool of one, without a thread to start.
                    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
                    match alone.build() {
                        Ok(pool) => pool.install(work),
                        Err(_) => work(),
                    }
                }
            },
        }
    }

    /// Away from the copy of a pool's thread, whose pool has no threads here.
    fn on_fresh_thread<R: Send>(work: impl FnOnce() -> R + Send) -> R {
        std::thread::scope(|scope| {
            scope.spawn(work).join().unwrap_or_else(|panicked| resume_unwind(panicked))
        })
    }

    /// A pool of so many threads, or the one of the process.
    ///
    /// It may be carried over a fork: the child starts threads of its own for each call, and does not drop what it
    /// inherited.
    pub struct Pool(Option<ManuallyDrop<Owned>>);

    impl Pool {
        /// `None`: the pool of the process.
        ///
        /// # Errors
        /// 0 threads, or threads that cannot be started.
        pub fn new(threads: Option<usize>) -> Result<Self> {
            let Some(threads) = threads else { return Ok(Self(None)) };
            super::check(threads)?;
            match Owned::start(threads) {
                Ok(owned) => Ok(Self(Some(ManuallyDrop::new(owned)))),
                Err(error) => Err(Error::Invalid(format!("threads = {threads}: {error}"))),
            }
        }

        /// Runs `work` where parallel iterators use this pool, and waits for it.
        pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
            match &self.0 {
                None => install(work),
                Some(owned) if owned.is_inherited() => {
                    match Self::new(Some(owned.pool.current_num_threads())) {
                        Ok(fresh) => fresh.install(work),
                        Err(_) => install(work),
                    }
                }
                Some(owned) => match standing() {
                    Standing::InCopy => on_fresh_thread(|| owned.pool.install(work)),
                    _ => owned.pool.install(work),
                },
            }
        }
    }

    impl Drop for Pool {
        fn drop(&mut self) {
            if let Some(owned) = self.0.take().filter(|owned| !owned.is_inherited()) {
                drop(ManuallyDrop::into_inner(owned));
            }
        }
    }

    /// A parallel iterator of [`prelude`](super::prelude): it is [`install`]ed at its end.
    #[must_use = "iterators are lazy"]
    pub struct Par<I>(I);

    impl<T> ParSlice<T> for [T] {
        fn par_iter(&self) -> Par<Iter<'_, T>>
        where
            T: Sync,
        {
            Par(IntoParallelIterator::into_par_iter(self))
        }

        fn par_iter_mut(&mut self) -> Par<IterMut<'_, T>>
        where
            T: Send,
        {
            Par(IntoParallelIterator::into_par_iter(self))
        }

        fn par_chunks_exact(&self, size: usize) -> Par<ChunksExact<'_, T>>
        where
            T: Sync,
        {
            Par(ParallelSlice::par_chunks_exact(self, size))
        }

        fn par_chunks_exact_mut(&mut self, size: usize) -> Par<ChunksExactMut<'_, T>>
        where
            T: Send,
        {
            Par(ParallelSliceMut::par_chunks_exact_mut(self, size))
        }

        fn par_chunks_mut(&mut self, size: usize) -> Par<ChunksMut<'_, T>>
        where
            T: Send,
        {
            Par(ParallelSliceMut::par_chunks_mut(self, size))
        }
    }

    impl<T: Send> IntoPar for Vec<T> {
        type Inner = rayon::vec::IntoIter<T>;

        fn into_par_iter(self) -> Par<Self::Inner> {
            Par(IntoParallelIterator::into_par_iter(self))
        }
    }

    impl IntoPar for Range<usize> {
        type Inner = rayon::range::Iter<usize>;

        fn into_par_iter(self) -> Par<Self::Inner> {
            Par(IntoParallelIterator::into_par_iter(self))
        }
    }

    impl<I: IndexedParallelIterator> Par<I> {
        /// Pairs with the items of another one.
        pub fn zip<Z: IntoPar<Inner: IndexedParallelIterator>>(
            self,
            other: Z,
        ) -> Par<iter::Zip<I, Z::Inner>> {
            Par(self.0.zip(other.into_par_iter().0))
        }

        /// Pairs of the position and the item.
        pub fn enumerate(self) -> Par<iter::Enumerate<I>> {
            Par(self.0.enumerate())
        }

        /// Fewer items than this are not spread over threads.
        pub fn with_min_len(self, least: usize) -> Par<iter::MinLen<I>> {
            Par(self.0.with_min_len(least))
        }

        /// More items than this are spread over threads.
        pub fn with_max_len(self, most: usize) -> Par<iter::MaxLen<I>> {
            Par(self.0.with_max_len(most))
        }
    }

    impl<I: ParallelIterator> Par<I> {
        /// Applies `f` to every item.
        pub fn map<R: Send, F: Fn(I::Item) -> R + Sync + Send>(self, f: F) -> Par<iter::Map<I, F>> {
            Par(self.0.map(f))
        }

        /// Applies `f` to every item with memory that `init` makes now and then. The results must not depend on it.
        pub fn map_init<T, R, N, F>(self, init: N, f: F) -> Par<iter::MapInit<I, N, F>>
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) -> R + Sync + Send,
            R: Send,
        {
            Par(self.0.map_init(init, f))
        }

        /// The items that `f` holds for.
        pub fn filter<F: Fn(&I::Item) -> bool + Sync + Send>(self, f: F) -> Par<iter::Filter<I, F>> {
            Par(self.0.filter(f))
        }

        /// The results of `f` that are some.
        pub fn filter_map<R: Send, F>(self, f: F) -> Par<iter::FilterMap<I, F>>
        where
            F: Fn(I::Item) -> Option<R> + Sync + Send,
        {
            Par(self.0.filter_map(f))
        }

        /// The items that are some.
        pub fn flatten<T: Send>(self) -> Par<impl ParallelIterator<Item = T>>
        where
            I: ParallelIterator<Item = Option<T>>,
        {
            Par(self.0.filter_map(|item| item))
        }

        /// The items of what `f` returns, one after the other.
        pub fn flat_map_iter<S, F>(self, f: F) -> Par<iter::FlatMapIter<I, F>>
        where
            S: IntoIterator<Item: Send>,
            F: Fn(I::Item) -> S + Sync + Send,
        {
            Par(self.0.flat_map_iter(f))
        }

        /// The items in order.
        pub fn collect<C: FromParallelIterator<I::Item> + Send>(self) -> C {
            install(|| self.0.collect())
        }

        /// Two collections from pairs, in order.
        pub fn unzip<A: Send, B: Send, X, Y>(self) -> (X, Y)
        where
            I: ParallelIterator<Item = (A, B)>,
            X: Default + Send + ParallelExtend<A>,
            Y: Default + Send + ParallelExtend<B>,
        {
            install(|| self.0.unzip())
        }

        /// Calls `f` with every item.
        pub fn for_each<F: Fn(I::Item) + Sync + Send>(self, f: F) {
            install(|| self.0.for_each(f));
        }

        /// Calls `f` with every item and memory that `init` makes now and then.
        pub fn for_each_init<T, N, F>(self, init: N, f: F)
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) + Sync + Send,
        {
            install(|| self.0.for_each_init(init, f));
        }

        /// Calls `f` with every item until there is an error.
        ///
        /// # Errors
        /// One of `f`; which one, where there are several, depends on the threads.
        pub fn try_for_each<E: Send, F>(self, f: F) -> std::result::Result<(), E>
        where
            F: Fn(I::Item) -> std::result::Result<(), E> + Sync + Send,
        {
            install(|| self.0.try_for_each(f))
        }

        /// The same with memory that `init` makes now and then.
        ///
        /// # Errors
        /// As [`try_for_each`](Self::try_for_each).
        pub fn try_for_each_init<T, E: Send, N, F>(self, init: N, f: F) -> std::result::Result<(), E>
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) -> std::result::Result<(), E> + Sync + Send,
        {
            install(|| self.0.try_for_each_init(init, f))
        }

        /// Whether `f` holds for every item.
        pub fn all<F: Fn(I::Item) -> bool + Sync + Send>(self, f: F) -> bool {
            install(|| self.0.all(f))
        }

        /// The first item with the least key.
        pub fn min_by_key<K: Ord + Send, F: Fn(&I::Item) -> K + Sync + Send>(self, f: F) -> Option<I::Item> {
            install(|| self.0.min_by_key(f))
        }
    }
}

#[cfg(not(feature = "parallel"))]
mod imp {
    use std::iter;
    use std::ops::Range;
    pub use std::slice::{ChunksExact, ChunksExactMut, ChunksMut, Iter, IterMut};

    use super::{IntoPar, ParSlice};
    use crate::error::Result;

    /// Calls `work`: the feature `parallel` is off.
    pub fn install<R: Send>(work: impl FnOnce() -> R + Send) -> R {
        work()
    }

    /// The calling thread: the feature `parallel` is off.
    pub struct Pool(());

    impl Pool {
        /// Whatever the number, work runs on the calling thread.
        ///
        /// # Errors
        /// 0 threads.
        pub fn new(threads: Option<usize>) -> Result<Self> {
            threads.map_or(Ok(()), super::check).map(Self)
        }

        /// Calls `work`.
        pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
            work()
        }
    }

    /// An iterator of [`prelude`](super::prelude), which runs on the calling thread.
    #[must_use = "iterators are lazy"]
    pub struct Par<I>(I);

    impl<T> ParSlice<T> for [T] {
        fn par_iter(&self) -> Par<Iter<'_, T>>
        where
            T: Sync,
        {
            Par(self.iter())
        }

        fn par_iter_mut(&mut self) -> Par<IterMut<'_, T>>
        where
            T: Send,
        {
            Par(self.iter_mut())
        }

        fn par_chunks_exact(&self, size: usize) -> Par<ChunksExact<'_, T>>
        where
            T: Sync,
        {
            Par(self.chunks_exact(size))
        }

        fn par_chunks_exact_mut(&mut self, size: usize) -> Par<ChunksExactMut<'_, T>>
        where
            T: Send,
        {
            Par(self.chunks_exact_mut(size))
        }

        fn par_chunks_mut(&mut self, size: usize) -> Par<ChunksMut<'_, T>>
        where
            T: Send,
        {
            Par(self.chunks_mut(size))
        }
    }

    impl<T: Send> IntoPar for Vec<T> {
        type Inner = std::vec::IntoIter<T>;

        fn into_par_iter(self) -> Par<Self::Inner> {
            Par(self.into_iter())
        }
    }

    impl IntoPar for Range<usize> {
        type Inner = Self;

        fn into_par_iter(self) -> Par<Self> {
            Par(self)
        }
    }

    // The bounds are those of the threaded twin, so that what compiles here compiles there.
    impl<I: Iterator> Par<I> {
        /// Pairs with the items of another one.
        pub fn zip<Z: IntoPar<Inner: Iterator>>(self, other: Z) -> Par<iter::Zip<I, Z::Inner>> {
            Par(self.0.zip(other.into_par_iter().0))
        }

        /// Pairs of the position and the item.
        pub fn enumerate(self) -> Par<iter::Enumerate<I>> {
            Par(self.0.enumerate())
        }

        /// Nothing is spread over threads.
        pub fn with_min_len(self, _least: usize) -> Self {
            self
        }

        /// Nothing is spread over threads.
        pub fn with_max_len(self, _most: usize) -> Self {
            self
        }

        /// Applies `f` to every item.
        pub fn map<R: Send, F: Fn(I::Item) -> R + Sync + Send>(self, f: F) -> Par<iter::Map<I, F>> {
            Par(self.0.map(f))
        }

        /// Applies `f` to every item with memory that `init` makes.
        pub fn map_init<T, R, N, F>(self, init: N, f: F) -> Par<impl Iterator<Item = R>>
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) -> R + Sync + Send,
            R: Send,
        {
            let mut memory = None;
            Par(self.0.map(move |item| f(memory.get_or_insert_with(&init), item)))
        }

        /// The items that `f` holds for.
        pub fn filter<F: Fn(&I::Item) -> bool + Sync + Send>(self, f: F) -> Par<iter::Filter<I, F>> {
            Par(self.0.filter(f))
        }

        /// The results of `f` that are some.
        pub fn filter_map<R: Send, F>(self, f: F) -> Par<iter::FilterMap<I, F>>
        where
            F: Fn(I::Item) -> Option<R> + Sync + Send,
        {
            Par(self.0.filter_map(f))
        }

        /// The items that are some.
        pub fn flatten<T: Send>(self) -> Par<impl Iterator<Item = T>>
        where
            I: Iterator<Item = Option<T>>,
        {
            Par(self.0.flatten())
        }

        /// The items of what `f` returns, one after the other.
        pub fn flat_map_iter<S, F>(self, f: F) -> Par<iter::FlatMap<I, S, F>>
        where
            S: IntoIterator<Item: Send>,
            F: Fn(I::Item) -> S + Sync + Send,
        {
            Par(self.0.flat_map(f))
        }

        /// The items in order.
        pub fn collect<C: FromIterator<I::Item> + Send>(self) -> C {
            self.0.collect()
        }

        /// Two collections from pairs, in order.
        pub fn unzip<A: Send, B: Send, X, Y>(self) -> (X, Y)
        where
            I: Iterator<Item = (A, B)>,
            X: Default + Send + Extend<A>,
            Y: Default + Send + Extend<B>,
        {
            self.0.unzip()
        }

        /// Calls `f` with every item.
        pub fn for_each<F: Fn(I::Item) + Sync + Send>(self, f: F) {
            self.0.for_each(f);
        }

        /// Calls `f` with every item and memory that `init` makes.
        pub fn for_each_init<T, N, F>(self, init: N, f: F)
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) + Sync + Send,
        {
            let mut memory = None;
            self.0.for_each(|item| f(memory.get_or_insert_with(&init), item));
        }

        /// Calls `f` with every item until there is an error.
        ///
        /// # Errors
        /// The first one of `f`.
        pub fn try_for_each<E: Send, F>(mut self, f: F) -> std::result::Result<(), E>
        where
            F: Fn(I::Item) -> std::result::Result<(), E> + Sync + Send,
        {
            self.0.try_for_each(f)
        }

        /// The same with memory that `init` makes.
        ///
        /// # Errors
        /// The first one of `f`.
        pub fn try_for_each_init<T, E: Send, N, F>(mut self, init: N, f: F) -> std::result::Result<(), E>
        where
            N: Fn() -> T + Sync + Send,
            F: Fn(&mut T, I::Item) -> std::result::Result<(), E> + Sync + Send,
        {
            let mut memory = None;
            self.0.try_for_each(|item| f(memory.get_or_insert_with(&init), item))
        }

        /// Whether `f` holds for every item.
        pub fn all<F: Fn(I::Item) -> bool + Sync + Send>(mut self, f: F) -> bool {
            self.0.all(f)
        }

        /// The first item with the least key.
        pub fn min_by_key<K: Ord + Send, F: Fn(&I::Item) -> K + Sync + Send>(self, f: F) -> Option<I::Item> {
            self.0.min_by_key(f)
        }
    }
}

fn check(threads: usize) -> crate::error::Result<()> {
    if threads == 0 {
        return Err(crate::error::Error::Invalid("threads is 0, it must be at least 1".into()));
    }
    Ok(())
}
