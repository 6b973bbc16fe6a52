// Voxels as words: the lower half holds the distance, ONE for a truncation length, plus BIAS, so that
// zeroed memory is unseen; the upper half holds the weight.
// Constants: ONE, BIAS.

const UNSEEN = -i32(BIAS);

fn stored_distance(word: u32) -> i32 {
    return i32(word & 0xffffu) - i32(BIAS);
}

fn stored_weight(word: u32) -> u32 {
    return word >> 16u;
}

fn voxel_word(distance: i32, weight: u32) -> u32 {
    return u32(distance + i32(BIAS)) | (weight << 16u);
}
