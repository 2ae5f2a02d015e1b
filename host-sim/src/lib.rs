//! motorbench on the host.
