//! Parallel iterators: the same results on any number of threads, also in a forked process.

use redundancy_core::chain::{Chain, catalog};
use redundancy_core::parallel::{Pool, install, prelude::*};

use crate::support::{random_q, rng};

fn squares(n: usize) -> Vec<usize> {
    (0..n).into_par_iter().map(|i| i * i).collect()
}

#[test]
fn every_adapter_agrees_with_the_plain_iterator() {
    let n = 1_000;
    let items: Vec<usize> = (0..n).collect();
    let expected: Vec<usize> = items.iter().map(|i| i * i).collect();
    for threads in [None, Some(1), Some(3)] {
        Pool::new(threads).unwrap().install(|| {
            assert_eq!(squares(n), expected);
            assert_eq!(items.par_iter().map_init(|| 1, |one, i| i * i * *one).collect::<Vec<_>>(), expected);
            let (doubled, same): (Vec<usize>, Vec<usize>) = items.par_iter().map(|i| (2 * i, *i)).unzip();
            assert_eq!((doubled[n - 1], &same), (2 * n - 2, &items));
            let mut out = vec![0; n];
            out.par_iter_mut().zip(&items[..]).enumerate().with_min_len(7).for_each(|(i, (out, item))| {
                *out = i * item;
            });
            assert_eq!(out, expected);
            let mut pieces = vec![0; 2 * n + 1];
            let rows = pieces.par_chunks_exact_mut(2).zip(items.par_chunks_exact(1)).with_max_len(5);
            rows.for_each_init(|| 3, |three, (piece, item)| piece[1] = *three * item[0]);
            assert_eq!((pieces[2 * n - 1], pieces[2 * n]), (3 * n - 3, 0));
            pieces.par_chunks_mut(4).for_each(|piece| piece[0] = 9);
            assert_eq!((pieces[0], pieces[1], pieces[2 * n]), (9, 0, 9));
            let even = |i: usize| i.is_multiple_of(2).then_some(i);
            let wanted: Vec<usize> = (0..n).step_by(2).collect();
            assert_eq!(items.par_iter().filter_map(|i| even(*i)).collect::<Vec<_>>(), wanted);
            assert_eq!(items.par_iter().map(|i| even(*i)).flatten().collect::<Vec<_>>(), wanted);
            assert_eq!((0..n).into_par_iter().filter(|i| i % 2 == 0).collect::<Vec<_>>(), wanted);
            assert_eq!(items.par_iter().flat_map_iter(|i| even(*i)).collect::<Vec<_>>(), wanted);
            assert!(items.par_iter().all(|i| *i < n) && !items.par_iter().all(|i| *i < n - 1));
            assert_eq!(items.par_iter().min_by_key(|i| (**i).abs_diff(600)), Some(&600));
            let refuse = |i: &usize| if *i == 500 { Err(*i) } else { Ok(()) };
            assert_eq!(items.par_iter().try_for_each(refuse), Err(500));
            assert_eq!(items.par_iter().try_for_each_init(|| (), |(), i| refuse(i)), Err(500));
            let all: Result<Vec<usize>, usize> =
                items.clone().into_par_iter().map(|i| refuse(&i).map(|()| i)).collect();
            assert_eq!(all, Err(500));
        });
    }
}

#[test]
fn no_threads_are_refused() {
    let error = Pool::new(Some(0)).err().unwrap().to_string();
    assert_eq!(error, "threads is 0, it must be at least 1");
}

#[test]
fn a_pool_is_not_left_by_what_runs_in_it() {
    let threads = || std::iter::repeat_n((), 64).collect::<Vec<_>>().into_par_iter();
    let names = || threads().map(|()| std::thread::current().id()).collect::<Vec<_>>();
    let pool = Pool::new(Some(1)).unwrap();
    let first = pool.install(|| std::thread::current().id());
    assert!(pool.install(names).iter().all(|name| *name == first));
    assert!(pool.install(|| install(names)).iter().all(|name| *name == first));
    assert_ne!(first, std::thread::current().id());
}

#[test]
fn a_panic_comes_back_to_the_caller() {
    let work = || install(|| squares(10).iter().for_each(|i| assert_ne!(*i, 81)));
    assert!(std::panic::catch_unwind(work).is_err());
    assert_eq!(squares(3), [0, 1, 4]);
}

/// Seconds after which the kernel ends a child that waits for threads that it does not have.
#[cfg(unix)]
const WATCHDOG: u32 = 60;

/// Whether `work` holds in a forked child.
#[cfg(unix)]
fn in_child(work: impl FnOnce() -> bool) -> bool {
    // SAFETY: the child only computes and leaves by `_exit`; what else the threads of this process hold is not touched.
    unsafe {
        let child = libc::fork();
        if child == 0 {
            libc::alarm(WATCHDOG);
            libc::_exit(i32::from(!work()));
        }
        let mut status = -1;
        assert_eq!(libc::waitpid(child, &raw mut status, 0), child);
        libc::WIFEXITED(status) && libc::WEXITSTATUS(status) == 0
    }
}

/// What a child uses that is forked from a thread of a pool: the C library gives the stacks of the other threads to new
/// threads there, so nothing may be on them.
#[cfg(unix)]
struct Batch {
    chain: Chain,
    q: Vec<f64>,
    expected: Vec<f64>,
    pool: Pool,
}

#[cfg(unix)]
impl Batch {
    fn new() -> &'static Self {
        let chain = catalog::load("iiwa14").unwrap();
        let mut rng = rng(3);
        let q = (0..1_000).flat_map(|_| random_q(&mut rng, &chain)).collect();
        let mut batch = Self { chain, q, expected: Vec::new(), pool: Pool::new(Some(2)).unwrap() };
        batch.expected = batch.poses();
        Box::leak(Box::new(batch))
    }

    fn poses(&self) -> Vec<f64> {
        let mut poses = vec![0.0; 16_000];
        self.chain.forward_batch(&self.q, None, &mut poses).unwrap();
        poses
    }

    /// In the pool of the process, in a pool from before the fork, and in a new one.
    fn is_the_same_in_all_pools(&self) -> bool {
        let fresh = Pool::new(Some(2)).unwrap();
        let same = || self.poses() == self.expected;
        same() && self.pool.install(same) && fresh.install(same)
    }
}

#[cfg(unix)]
#[test]
fn parallel_work_survives_a_fork() {
    let batch = Batch::new();
    assert!(batch.is_the_same_in_all_pools());
    // From a thread of no pool, from there once more, and from the threads of two pools.
    assert!(in_child(|| batch.is_the_same_in_all_pools()));
    let twice = || in_child(|| batch.is_the_same_in_all_pools()) && batch.is_the_same_in_all_pools();
    assert!(in_child(twice));
    assert!(install(move || in_child(|| batch.is_the_same_in_all_pools())));
    assert!(batch.pool.install(move || in_child(|| batch.is_the_same_in_all_pools())));
    assert!(batch.is_the_same_in_all_pools());
}

#[cfg(unix)]
#[test]
fn a_child_may_drop_the_pool_of_its_parent() {
    let batch = Batch::new();
    let same = || batch.poses() == batch.expected;
    let pool = std::cell::RefCell::new(Some(Pool::new(Some(2)).unwrap()));
    assert!(in_child(|| {
        drop(pool.take());
        same()
    }));
    assert!(pool.take().is_some_and(|pool| pool.install(same)));
}
