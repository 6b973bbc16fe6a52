//! The triangles of virtual objects on the device, as [`SceneRays`].

use crate::gpu::{Gpu, GpuBuffer, GpuError};
use crate::math::bvh::Bvh;
use crate::scene::{Model, SceneRays, VirtualScene, triangle_corners};
use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3A};
use std::sync::Arc;

/// As in `shaders/transfer_traced/triangles.wgsl`, where it is told what they mean; so are the others.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Instance {
    object_from_world: [[f32; 4]; 4],
    sphere: [f32; 4],
    first: u32,
    end: u32,
    pad: [u32; 2],
}

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Node {
    low: [f32; 3],
    next: u32,
    high: [f32; 3],
    first: u32,
    end: u32,
    pad: [u32; 3],
}

pub type Triangle = [[f32; 4]; 3];

/// Objects that have a place. Models are uploaded when they are new, places each time.
pub struct GpuSceneRays {
    scene: SceneRays,
    /// Models on the device, with their first nodes and those after their last.
    models: Vec<(Arc<Model>, [u32; 2])>,
    pub nodes: GpuBuffer<Node>,
    pub triangles: GpuBuffer<Triangle>,
    pub instances: GpuBuffer<Instance>,
}

#[derive(Default)]
struct Lists {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

impl GpuSceneRays {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            scene: SceneRays::default(),
            models: Vec::new(),
            nodes: GpuBuffer::new(gpu, "nodes of objects", 1)?,
            triangles: GpuBuffer::new(gpu, "triangles of objects", 1)?,
            instances: GpuBuffer::new(gpu, "places of objects", 1)?,
        })
    }

    /// Takes in where objects stand now, for the commands that are submitted next.
    pub fn update(&mut self, gpu: &Gpu, scene: &VirtualScene) -> Result<(), GpuError> {
        self.scene.update(scene);
        let shown = self.scene.models().iter().map(|(model, _)| Arc::as_ptr(model));
        if !shown.eq(self.models.iter().map(|(model, _)| Arc::as_ptr(model))) {
            self.upload_models(gpu)?;
        }
        let instances: Vec<Instance> = self
            .scene
            .instances()
            .iter()
            .map(|instance| {
                let (_, [first, end]) = self.models[instance.model];
                let sphere = instance.bounds.centre.extend(instance.bounds.radius).to_array();
                let object_from_world = Mat4::from(instance.object_from_world).to_cols_array_2d();
                Instance { object_from_world, sphere, first, end, pad: [0; 2] }
            })
            .collect();
        upload(gpu, &mut self.instances, &instances)
    }

    pub fn len(&self) -> usize {
        self.scene.instances().len()
    }

    fn upload_models(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        let mut lists = Lists::default();
        self.models.clear();
        for (model, bvh) in self.scene.models() {
            self.models.push((model.clone(), lists.add(model, bvh)));
        }
        upload(gpu, &mut self.nodes, &lists.nodes)?;
        upload(gpu, &mut self.triangles, &lists.triangles)
    }
}

impl Lists {
    fn add(&mut self, model: &Model, bvh: &Bvh) -> [u32; 2] {
        let (first_node, first) = (self.nodes.len(), self.triangles.len());
        self.nodes.extend(bvh.flattened().into_iter().map(|node| Node {
            low: node.bounds.min.to_array(),
            next: (first_node + node.next) as u32,
            high: node.bounds.max.to_array(),
            first: (first + node.items.start) as u32,
            end: (first + node.items.end) as u32,
            pad: [0; 3],
        }));
        let padded = |p: Vec3A| p.extend(0.0).to_array();
        let triangles =
            bvh.items().iter().map(|&t| triangle_corners(model, t as usize).map(padded));
        self.triangles.extend(triangles);
        [first_node as u32, self.nodes.len() as u32]
    }
}

/// Makes room where there is too little.
fn upload<T: Pod>(gpu: &Gpu, buffer: &mut GpuBuffer<T>, values: &[T]) -> Result<(), GpuError> {
    if buffer.len() < values.len() {
        *buffer = GpuBuffer::new(gpu, buffer.label(), values.len())?;
    }
    buffer.upload(gpu, values);
    Ok(())
}
