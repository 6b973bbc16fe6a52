// Ends an integration: which slots are free now, and counts for the next one.
#import fusion/blocks

@group(0) @binding(0) var<uniform> params: GridUniform;
@group(0) @binding(1) var<storage, read_write> counters: Counters;
@group(0) @binding(2) var<storage, read_write> groups: array<u32>;

@compute @workgroup_size(1)
fn main() {
    let taken = atomicLoad(&counters.taken);
    let reused = min(taken, counters.free);
    let used = counters.used + (taken - reused);
    counters.used = min(used, params.capacity - 1u);
    counters.refused += used - counters.used;
    counters.free += atomicLoad(&counters.released) - reused;
    atomicStore(&counters.taken, 0u);
    atomicStore(&counters.released, 0u);
    atomicStore(&counters.max_depth_bits, 0u);
    groups[0] = 0u;
    groups[1] = 1u;
    groups[2] = 1u;
}
