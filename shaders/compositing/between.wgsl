// Grid points on either side of a pixel along one image axis, and the weight of the second.
struct Between {
    first: u32,
    second: u32,
    share: f32,
}
