//! Measures: light direction, trajectory, picture error.
