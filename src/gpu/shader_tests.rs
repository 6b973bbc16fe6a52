//! Every shader, without a device.

use super::pipeline::{Reflection, parse};
use super::shader::library;
use super::stages::{drawing_shaders, shaders};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use std::collections::BTreeSet;
use std::path::Path;

fn files_below(folder: &Path, prefix: &str, found: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            files_below(&path, &format!("{prefix}{name}/"), found);
        } else if path.extension().is_some_and(|e| e == "wgsl") {
            found.insert(format!("{prefix}{name}"));
        }
    }
}

#[test]
fn the_library_holds_every_file() {
    let mut found = BTreeSet::new();
    files_below(&Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders"), "", &mut found);
    let listed: BTreeSet<String> = library::FILES.iter().map(|(f, _)| f.to_string()).collect();
    assert_eq!(found, listed);
}

#[test]
fn every_shader_is_valid_within_the_limits_of_webgpu() {
    let limits = wgpu::Limits::default();
    let (computing, drawing) = (shaders(), drawing_shaders());
    let shaders: Vec<_> = computing.iter().chain(&drawing).collect();
    for (at, shader) in shaders.iter().enumerate() {
        let module = parse(shader).unwrap_or_else(|e| panic!("{e}"));
        let checked =
            Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
        checked.unwrap_or_else(|e| {
            panic!("{}: {}", shader.file, e.emit_to_string(&shader.compose().unwrap()))
        });
        let draws = at >= computing.len();
        let reflect = if draws { Reflection::of_drawing } else { Reflection::of };
        let reflection = reflect(shader, &module).unwrap_or_else(|e| panic!("{e}"));
        let storage = reflection.storage_bindings();
        assert!(storage <= limits.max_storage_buffers_per_shader_stage as usize, "{}", shader.file);
        let invocations: u32 = reflection.workgroup.iter().product();
        assert!(invocations <= limits.max_compute_invocations_per_workgroup, "{}", shader.file);
    }
    // whatever is not imported by another file is the main file of some shader
    let mains: BTreeSet<&str> = shaders.iter().map(|s| s.file).collect();
    let unused = library::FILES.iter().filter(|(file, _)| !mains.contains(file));
    let unused = unused.filter(|(file, _)| {
        !library::FILES.iter().any(|(_, text)| text.lines().any(|l| l == format!("#import {file}")))
    });
    assert_eq!(unused.map(|(file, _)| file).collect::<Vec<_>>(), Vec::<&&str>::new());
}

#[test]
fn a_broken_shader_is_named_with_its_line() {
    let shader = super::Shader::new("no/such");
    assert!(parse(&shader).unwrap_err().to_string().contains("shaders/no/such.wgsl"));
    // the constant that the text needs is missing
    let error = parse(&super::Shader::new("input/color")).unwrap_err().to_string();
    assert!(error.contains("ROOTS") && error.contains("input/color"), "{error}");
}
