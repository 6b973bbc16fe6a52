//! Shader texts, put together from files.

use super::GpuError;
use std::collections::HashSet;
use std::fmt::Write as _;

/// All files below `shaders/`, by path without ending.
pub mod library {
    macro_rules! files {
        ($($name:literal),+ $(,)?) => {
            /// Path below `shaders/` without `.wgsl`, and text.
            pub const FILES: &[(&str, &str)] = &[
                $(($name, include_str!(concat!("../../shaders/", $name, ".wgsl")))),+
            ];
        };
    }
    files![
        "compositing/between",
        "compositing/bicubic",
        "compositing/blur",
        "compositing/lamp",
        "compositing/likeness",
        "compositing/means",
        "compositing/pixels",
        "compositing/planes",
        "compositing/shade",
        "compositing/smooth",
        "compositing/sum",
        "compositing/sums",
        "compositing/upsample",
        "compositing/virtual_light",
        "dyn_geo/median",
        "dyn_geo/merge",
        "dyn_geo/model_depth",
        "dyn_geo/normals",
        "exitant/radiance",
        "fusion/allocate",
        "fusion/blocks",
        "fusion/color",
        "fusion/crossings",
        "fusion/empty",
        "fusion/fuse",
        "fusion/integrate",
        "fusion/look_up",
        "fusion/mark",
        "fusion/raycast",
        "fusion/rays",
        "fusion/release",
        "fusion/sample",
        "fusion/settle",
        "fusion/survey",
        "fusion/survey_x",
        "fusion/tiles",
        "fusion/voxels",
        "fusion/walk",
        "input/color",
        "input/depth",
        "light_samples/candidates",
        "light_samples/judge",
        "light_samples/pick",
        "light_samples/picture",
        "raster/color",
        "raster/draw",
        "raster/resolve",
        "raster/scene",
        "raster/visible",
        "shared/color",
        "shared/median",
        "shared/view",
        "tracking/bilateral",
        "tracking/cells",
        "tracking/halve",
        "tracking/lens",
        "tracking/normals",
        "tracking/sums",
        "tracking/totals",
        "transfer/emitter",
        "transfer/farthest",
        "transfer/insert",
        "transfer/limits",
        "transfer/lobe",
        "transfer/merged",
        "transfer/real",
        "transfer/sampling",
        "transfer_traced/again",
        "transfer_traced/cells",
        "transfer_traced/interpolate",
        "transfer_traced/list",
        "transfer_traced/objects",
        "transfer_traced/plan",
        "transfer_traced/points",
        "transfer_traced/project",
        "transfer_traced/refine",
        "transfer_traced/smooth",
        "transfer_traced/surfaces",
        "transfer_traced/triangles",
        "transfer_traced/volume",
    ];

    /// The text of a file.
    pub fn text(name: &str) -> Option<&'static str> {
        FILES.iter().find(|(file, _)| *file == name).map(|(_, text)| *text)
    }
}

/// A constant that is fixed when a shader is put together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Constant {
    U32(u32),
    F32(f32),
    Bool(bool),
}

impl Constant {
    /// Equal keys are equal texts.
    fn declaration(self, name: &str) -> String {
        match self {
            Self::U32(value) => format!("const {name}: u32 = {value}u;\n"),
            Self::Bool(value) => format!("const {name} = {value};\n"),
            // Debug prints the shortest digits that read back as the same value
            Self::F32(value) => format!("const {name}: f32 = f32({value:?});\n"),
        }
    }
}

/// The shader of a file, with constants: a function `main` that computes, or `vertex_main` and
/// `fragment_main` that draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Shader {
    pub file: &'static str,
    pub constants: Vec<(&'static str, Constant)>,
}

impl Shader {
    pub const fn new(file: &'static str) -> Self {
        Self { file, constants: Vec::new() }
    }

    /// Declares a constant before the file's text; it must not be declared there.
    pub fn with(mut self, name: &'static str, value: Constant) -> Self {
        self.constants.push((name, value));
        self
    }

    pub fn with_u32(self, name: &'static str, value: usize) -> Self {
        self.with(name, Constant::U32(value as u32))
    }

    pub fn with_bool(self, name: &'static str, value: bool) -> Self {
        self.with(name, Constant::Bool(value))
    }

    /// The whole text: constants, then the file with every `#import path` line replaced by that file,
    /// once.
    pub fn compose(&self) -> Result<String, GpuError> {
        let mut text = String::new();
        for (name, value) in &self.constants {
            text.push_str(&value.declaration(name));
        }
        self.append(self.file, &mut HashSet::new(), &mut text)?;
        Ok(text)
    }

    fn append(
        &self,
        file: &str,
        seen: &mut HashSet<String>,
        out: &mut String,
    ) -> Result<(), GpuError> {
        if !seen.insert(file.to_owned()) {
            return Ok(());
        }
        let text = library::text(file).ok_or_else(|| GpuError::Shader {
            shader: self.file.to_owned(),
            problem: format!("there is no file shaders/{file}.wgsl"),
        })?;
        for line in text.lines() {
            match line.strip_prefix("#import ") {
                Some(import) => self.append(import.trim(), seen, out)?,
                None => writeln!(out, "{line}").expect("writing to a string"),
            }
        }
        Ok(())
    }
}
