//! What the machine does at most, with all threads of the pool.

use divan::counter::{BytesCount, ItemsCount};
use divan::{Bencher, black_box};
use rayon::prelude::*;

/// 64 MiB, larger than the caches, copied in pieces; bytes read and bytes written count.
#[divan::bench]
fn copy_bandwidth(bencher: Bencher) {
    const BYTES: usize = 64 << 20;
    const PIECE: usize = 1 << 20;
    let source = vec![1u8; BYTES];
    let mut target = vec![0u8; BYTES];
    bencher.counter(BytesCount::new(2 * BYTES)).bench_local(|| {
        target.par_chunks_mut(PIECE).zip(source.par_chunks(PIECE)).for_each(|(to, from)| {
            to.copy_from_slice(from);
        });
        black_box(&mut target);
    });
}

const LANES: usize = 16;
/// Independent chains of operations, more than the latency of one asks for.
const CHAINS: usize = 8;
const STEPS: usize = 20_000;

/// f32 multiplications and additions in registers, as the kernels make them: not contracted.
#[divan::bench]
fn operation_rate(bencher: Bencher) {
    const TASKS: usize = 64;
    let operations = TASKS * STEPS * CHAINS * LANES * 2;
    bencher.counter(ItemsCount::new(operations)).bench_local(|| {
        (0..TASKS)
            .into_par_iter()
            .map(|task| multiply_add(black_box(0.999), black_box(1.0 + task as f32)))
            .sum::<f32>()
    });
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn multiply_add(factor: f32, summand: f32) -> f32 {
    let start = |c: usize| std::array::from_fn(|i| (c * LANES + i) as f32);
    let mut chains: [Chain; CHAINS] = std::array::from_fn(start);
    for _ in 0..STEPS {
        // By name and by value, so that each chain stays in a register.
        let [a, b, c, d, e, f, g, h] = chains;
        let next = |chain| advanced(chain, factor, summand);
        chains = [next(a), next(b), next(c), next(d), next(e), next(f), next(g), next(h)];
    }
    chains.as_flattened().iter().sum()
}

type Chain = [f32; LANES];

#[inline(always)]
fn advanced(mut chain: Chain, factor: f32, summand: f32) -> Chain {
    for i in 0..LANES {
        chain[i] = chain[i] * factor + summand;
    }
    chain
}
