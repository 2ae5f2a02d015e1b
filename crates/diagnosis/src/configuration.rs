//! Every number that the diagnosis goes by, with its reason: thresholds, sizes of searches, priors, and facts of chips and of
//! statistics. The modules are those that use them.

pub(crate) mod compare;
pub(crate) mod dataset;
pub(crate) mod diagnose;
pub(crate) mod evidence;
pub(crate) mod free_run;
pub(crate) mod identify;
pub(crate) mod steady_state;
