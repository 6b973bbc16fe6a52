// Transfer of real and virtual surfaces together, and one bounce of light (Gruber et al. 2015, Sec. 5.3).
// `transfer` holds that of the real scene; it is written anew on virtual surfaces, and where a sample
// may be behind a virtual pixel.
#import transfer/emitter
#import transfer/sampling
#import transfer/lobe

@group(0) @binding(1) var<storage, read> directions: array<vec4f>;
@group(0) @binding(2) var<storage, read> distances_m: array<f32>;
@group(0) @binding(3) var<storage, read> limits_m: array<f32>;
@group(0) @binding(4) var<storage, read> emitters: array<Emitter>;
@group(0) @binding(5) var<storage, read> extents: array<u32>;
@group(0) @binding(6) var<storage, read_write> transfer: array<f32>;
@group(0) @binding(7) var<storage, read_write> indirect: array<vec4f>;

// Bounds of x * scale / w + centre along one axis, for x and w within r of the point's.
fn reach(x: f32, w: vec2f, scale: f32, centre: f32) -> vec2f {
    let r = params.farthest_m;
    let ends = vec4f((x - r) / w.x, (x - r) / w.y, (x + r) / w.x, (x + r) / w.y) * scale;
    let low = min(min(ends.x, ends.y), min(ends.z, ends.w));
    let high = max(max(ends.x, ends.y), max(ends.z, ends.w));
    return vec2f(low, high) + centre;
}

// Whether a sample may be behind a virtual pixel, or behind what that covers. Errs on the side of
// yes, by a pixel.
fn meets_virtual(v: u32) -> bool {
    let extent = v * EXTENT_WORDS;
    if extents[extent + 1u] == 0u {
        return false;
    }
    let x = point_in_view[v];
    let nearest_m = bitcast<f32>(~extents[extent + 4u]);
    if x.z + params.farthest_m <= nearest_m {
        return false;
    }
    var w = vec2f(1.0);
    if params.views[v].perspective == 1u {
        w = x.z + vec2f(-1.0, 1.0) * params.farthest_m;
        if w.x <= 1e-3 {
            return true;
        }
    }
    let size = params.views[v].size;
    let right = f32(extents[extent + 1u]);
    let bottom = f32(extents[extent + 3u]);
    let left = f32(size.x - extents[extent]) - 1.0;
    let top = f32(size.y - extents[extent + 2u]) - 1.0;
    let u = reach(x.x, w, params.views[v].scale.x, params.views[v].centre.x);
    let row = reach(x.y, w, params.views[v].scale.y, params.views[v].centre.y);
    return u.y >= left && u.x <= right && row.y >= top && row.x <= bottom;
}

fn meets_any_virtual() -> bool {
    for (var v = 0u; v < VIEWS; v++) {
        if meets_virtual(v) {
            return true;
        }
    }
    return false;
}

// What a hiding surface s sends to the point: B(s) where s faces it. Real surfaces get the light of
// virtual ones alone (Eq. 14), virtual surfaces that of all.
fn light_from(found: Fit, x_in_world: vec3f, on_virtual: bool) -> vec3f {
    let emitter = emitters[found.pixel];
    if !(on_virtual || emitter.radiance.w == 1.0) {
        return vec3f(0.0);
    }
    let view = found.view;
    let at = found.pixel - params.views[view].first;
    let width = params.views[view].size.x;
    let pixel = vec2f(vec2u(at % width, at / width));
    let depth_m = emitter.surface.w;
    let w = select(1.0, depth_m, params.views[view].perspective == 1u);
    let in_view = vec3f((pixel - params.views[view].centre) / params.views[view].scale * w, depth_m);
    let s = moved(params.views[view].world_from_view, in_view);
    return select(vec3f(0.0), emitter.radiance.rgb, dot(emitter.surface.xyz, x_in_world - s) > 0.0);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= params.grid) {
        return;
    }
    let at = id.y * params.grid.x + id.x;
    let first = at * COEFFICIENTS;
    let pixel = grid_pixel(id.xy);
    let receiver = emitters[pixel.y * params.views[0].size.x + pixel.x];
    let on_virtual = receiver.radiance.w == 1.0;
    let point = point_of(pixel, receiver.surface);
    var light = vec3f(0.0);
    if point.is_valid {
        show_to_views(point);
        if on_virtual || meets_any_virtual() {
            let sum = sum_of_cosines(point.n);
            let distances = first_distance(id.xy);
            let x_in_world = moved(params.views[0].world_from_view, point.x);
            for (var d = 0u; d < params.directions; d++) {
                let w = directions[d * ROW].xyz;
                let cosine = dot(point.n, w);
                if cosine > 0.0 {
                    let found = look(w, distances + d * params.samples);
                    let share = hiddenness(found.cosine);
                    if share > 0.0 {
                        hide(share * cosine / sum, d);
                        light += share * cosine * light_from(found, x_in_world, on_virtual);
                    }
                }
            }
            light *= params.strength / max(sum, 1e-20);
            write_transfer(first, point.n);
        }
    } else if on_virtual {
        write_nothing(first);
    }
    indirect[at] = vec4f(light, 0.0);
}
