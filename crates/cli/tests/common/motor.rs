//! The test stand's motor as text for a rig, model or scenario file.

/// `MotorParameters::PIVT6`.
pub const PIVT6_TOML: &str = "[motor]
resistance_ohm = 5.84
inductance_H = 11.68e-3
torque_constant_Nm_per_A = 0.072
inertia_kg_m2 = 2.22e-5
viscous_friction_Nm_s = 5e-6
";
