//! The parallel shapes that loading and structures need. Without `preprocess` they run on the caller's thread; results are the
//! same bytes either way, because every item writes a place of its own.

/// `f` of every item, in order.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "preprocess")]
    {
        use rayon::prelude::*;
        items.par_iter().map(f).collect()
    }
    #[cfg(not(feature = "preprocess"))]
    items.iter().map(f).collect()
}

/// Calls `f(index of the first item, items)` for consecutive blocks of at most `block` items.
pub(crate) fn fill<T: Send>(out: &mut [T], block: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    #[cfg(feature = "preprocess")]
    {
        use rayon::prelude::*;
        out.par_chunks_mut(block).enumerate().for_each(|(i, items)| f(i * block, items));
    }
    #[cfg(not(feature = "preprocess"))]
    for (i, items) in out.chunks_mut(block).enumerate() {
        f(i * block, items);
    }
}

/// Sorts. Items that tie must be the same, or which comes first is chance.
pub(crate) fn sort<T: Ord + Send>(items: &mut [T]) {
    #[cfg(feature = "preprocess")]
    {
        use rayon::prelude::*;
        items.par_sort_unstable();
    }
    #[cfg(not(feature = "preprocess"))]
    items.sort_unstable();
}

/// How many items of [`map`] can run at once.
#[cfg(feature = "las")]
pub(crate) fn width() -> usize {
    #[cfg(feature = "preprocess")]
    {
        rayon::current_num_threads()
    }
    #[cfg(not(feature = "preprocess"))]
    1
}
