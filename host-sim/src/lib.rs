//! motorbench on the host.

#[cfg(feature = "chip")]
pub mod chip;
pub mod plant;
