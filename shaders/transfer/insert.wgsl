// The same with virtual surfaces, what a sample meets there, and where virtual pixels are.
#import transfer/emitter
#import transfer/farthest

@group(0) @binding(0) var<uniform> params: LimitsUniform;
@group(0) @binding(1) var<storage, read> surface: array<vec4f>;
@group(0) @binding(2) var<storage, read> origin: array<u32>;
@group(0) @binding(3) var<storage, read> radiance: array<vec4f>;
@group(0) @binding(4) var<storage, read> real_limits_m: array<f32>;
@group(0) @binding(5) var<storage, read_write> limits_m: array<f32>;
@group(0) @binding(6) var<storage, read_write> emitters: array<Emitter>;
@group(0) @binding(7) var<storage, read_write> extents: array<atomic<u32>>;

const VIRTUAL = 3u;

var<workgroup> extent: array<atomic<u32>, EXTENT_WORDS>;

// A virtual pixel changes what is beyond the nearer of the limits with and without it.
fn widen(pixel: vec2u, before_m: f32, after_m: f32) {
    let words = extent_of(params.view.size, pixel, min(before_m, after_m));
    for (var i = 0u; i < EXTENT_WORDS; i++) {
        atomicMax(&extent[i], words[i]);
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) local: u32) {
    if all(id.xy < params.view.size) {
        let at = id.y * params.view.size.x + id.x;
        let shown = surface[at];
        let is_virtual = origin[at] == VIRTUAL;
        let before_m = real_limits_m[params.first + at];
        var after_m = before_m;
        if is_virtual {
            after_m = hidden_beyond(id.xy, shown);
            widen(id.xy, before_m, after_m);
        }
        limits_m[params.first + at] = after_m;
        emitters[params.first + at] =
            Emitter(shown, vec4f(radiance[at].rgb, select(0.0, 1.0, is_virtual)));
    }
    workgroupBarrier();
    if local < EXTENT_WORDS {
        let found = atomicLoad(&extent[local]);
        if found > 0u {
            atomicMax(&extents[params.extent * EXTENT_WORDS + local], found);
        }
    }
}
