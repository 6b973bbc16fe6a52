// Unoccluded transfer less what is hidden. The main file declares `transfer`.

var<private> hidden: array<vec4f, QUADS>;

fn hide(share: f32, direction: u32) {
    for (var q = 0u; q < QUADS; q++) {
        hidden[q] += share * directions[direction * ROW + 1u + q];
    }
}

fn put(first: u32, k: u32, lobe: f32) {
    transfer[first + k] = lobe - hidden[k / 4u][k % 4u];
}

// As `sh::basis_lanes`, with the factors of the clamped cosine in the table.
fn write_transfer(first: u32, n: vec3f) {
    var turn = vec2f(1.0, 0.0);
    var diagonal = 1.0;
    for (var m = 0u; m < BANDS; m++) {
        var previous = 0.0;
        var current = diagonal;
        for (var l = m; l < BANDS; l++) {
            let at = 6u * l + m;
            let k = params.lobe[at / 4u][at % 4u] * current;
            put(first, l * (l + 1u) + m, k * turn.x);
            if m > 0u {
                put(first, l * (l + 1u) - m, k * turn.y);
            }
            let next = (n.z * f32(2u * l + 1u) * current - f32(l + m) * previous) / f32(l + 1u - m);
            previous = current;
            current = next;
        }
        turn = vec2f(turn.x * n.x - turn.y * n.y, turn.x * n.y + turn.y * n.x);
        diagonal *= f32(2u * m + 1u);
    }
}

fn write_nothing(first: u32) {
    for (var k = 0u; k < COEFFICIENTS; k++) {
        transfer[first + k] = 0.0;
    }
}
