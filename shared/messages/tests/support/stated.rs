//! What a device states of itself, for the tests of all who read it.

use hyst_messages::{DeviceLimits, DeviceStatement, STATEMENT_VERSION, statement_text};

/// A sound statement: as much force as the simulated device's, 1 000 samples in a second, and nothing said of its damping.
pub fn stated() -> DeviceStatement {
    DeviceStatement {
        version: STATEMENT_VERSION,
        measured_dof: 4,
        driven_dof: 3,
        rate_hz: 1_000.0,
        limits: DeviceLimits { max_force_n: 3.3, max_stiffness_n_m: 1_200.0, max_damping_n_s_m: 2.0 },
        continuous_force_n: 0.9,
        pitch_rad: [-0.6, 0.6],
        yaw_rad: [-0.6, 0.6],
        roll_rad: [-3.0, 3.0],
        insertion_m: [0.0, 0.1],
        maker: statement_text("Nobody"),
        name: statement_text("Nothing"),
        ..DeviceStatement::default()
    }
}
