//! Plots and the self-contained report page.
//!
//! ```text
//! folders -> Sources (records that are there) -> sections (figures, tables, pictures) -> one HTML file
//! ```
//!
//! [`figures`] draws each plot as an SVG text that stands alone, so that a study can lay its plots
//! beside its JSON.

pub mod figures;
mod markup;
mod page;
mod paper;
mod pictures;
mod run_record;
mod sections;
mod sources;
mod statistics;
mod ticks;

pub use page::{Page, page, write_report};
pub use run_record::{RUN_RECORD, RunRecord};
pub use sources::{Found, Problem, RunFolder, Sources};

#[cfg(test)]
pub(crate) mod fixtures;
#[cfg(test)]
mod tests;
