// From the samples of each block to those before it, in place: one workgroup for all blocks.

struct ScanUniform {
    blocks: u32,
    pad: u32,
}

const WIDTH = 256u;

@group(0) @binding(0) var<uniform> params: ScanUniform;
@group(0) @binding(1) var<storage, read_write> block_used: array<u32>;

var<workgroup> sums: array<u32, WIDTH>;

@compute @workgroup_size(WIDTH)
fn main(@builtin(local_invocation_index) local: u32) {
    let share = (params.blocks + WIDTH - 1u) / WIDTH;
    let first = min(local * share, params.blocks);
    let end = min(first + share, params.blocks);
    var own = 0u;
    for (var block = first; block < end; block++) {
        own += block_used[block];
    }
    sums[local] = own;
    workgroupBarrier();
    for (var reach = 1u; reach < WIDTH; reach *= 2u) {
        var before = 0u;
        if local >= reach {
            before = sums[local - reach];
        }
        workgroupBarrier();
        sums[local] += before;
        workgroupBarrier();
    }
    var before = sums[local] - own;
    for (var block = first; block < end; block++) {
        let used = block_used[block];
        block_used[block] = before;
        before += used;
    }
}
