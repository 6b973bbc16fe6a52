// Virtual objects: models, each a hierarchy of boxes over its triangles, and where they stand.

struct Instance {
    object_from_world: mat4x4f,
    // centre and radius in the world
    sphere: vec4f,
    // its model's nodes
    first: u32,
    end: u32,
    pad0: u32,
    pad1: u32,
}

// Nodes lie depth first: a box that is met is followed by its first child, or by the next box.
struct Node {
    low: vec3f,
    // where to go on if the box is missed
    next: u32,
    high: vec3f,
    // its triangles; none where it is no leaf
    first: u32,
    end: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

struct Triangle {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}
