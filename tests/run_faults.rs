//! What can go wrong around a run, through the program itself: disks that fill up, folders and files that vanish,
//! signals, a terminal that is gone. What was written is whole, the exit code says what happened, and nobody waits.
#![cfg(target_os = "linux")]

mod common;
#[path = "run_faults/disks.rs"]
mod disks;
#[path = "run_faults/interrupts.rs"]
mod interrupts;
#[path = "run_faults/kills.rs"]
mod kills;
#[path = "run_faults/made.rs"]
mod made;
#[path = "run_faults/terminals.rs"]
mod terminals;
#[path = "run_faults/vanishing.rs"]
mod vanishing;
#[path = "run_faults/whole.rs"]
mod whole;
