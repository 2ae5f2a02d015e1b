//! The same function of many items: on all cores where the program asks for threads.

use std::sync::{Mutex, PoisonError};

/// The results, in the order of the items.
pub(crate) fn map<T: Send, R: Send>(items: impl IntoIterator<Item = T>, of: impl Fn(T) -> R + Sync) -> Vec<R> {
    // Each place is taken by one call.
    let places: Vec<_> = items.into_iter().map(|item| Mutex::new((Some(item), None))).collect();
    let place = |index: usize| places[index].lock().unwrap_or_else(PoisonError::into_inner);
    each_of(places.len(), &|index| {
        let item = place(index).0.take();
        let result = item.map(&of);
        place(index).1 = result;
    });
    let results = places.into_iter().filter_map(|place| place.into_inner().unwrap_or_else(PoisonError::into_inner).1);
    results.collect()
}

/// Calls a function with each number below `count`. It is not generic: Rayon's iterators compile slowly, and would be
/// compiled for each closure.
#[cfg(feature = "parallel")]
fn each_of(count: usize, call: &(dyn Fn(usize) + Sync)) {
    use rayon::prelude::*;
    (0..count).into_par_iter().for_each(call);
}

#[cfg(not(feature = "parallel"))]
fn each_of(count: usize, call: &(dyn Fn(usize) + Sync)) {
    (0..count).for_each(call);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_the_order_of_their_items() {
        let nested = |tens: usize| map(0..10, |ones| 10 * tens + ones);
        let all: Vec<usize> = map(0..10, nested).concat();
        assert_eq!(all, (0..100).collect::<Vec<_>>());
        assert!(map(Vec::<String>::new(), |text| text.len()).is_empty());
    }
}
