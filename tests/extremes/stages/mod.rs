//! Each stage alone, against what mathematics says of it.

mod continuity;
mod filters;
mod light;
mod light_truth;
mod long;
mod made;
mod on_device;
mod precision;
mod registration;
mod shading;
mod transfer_oracle;

use crate::table::Table;

pub fn add_cases(table: &mut Table) {
    precision::add_cases(table);
    filters::add_cases(table);
    registration::add_cases(table);
    shading::add_cases(table);
    light::add_cases(table);
    light_truth::add_cases(table);
    continuity::add_cases(table);
    long::add_cases(table);
}
