//! Buffers of the pipeline as viewable pictures, for `--dump`.

use super::args::Buffer;
use clap::ValueEnum;
use kinlight::image::Image;
use kinlight::math::color::luminance;
use kinlight::output::{Range, depth_picture, normal_picture, origin_picture, value_picture};
use kinlight::pipeline::Pipeline;

/// Depth is drawn from near (bright) to far over this range, metres, the same in every frame.
const DEPTH_RANGE_M: (f32, f32) = (0.3, 4.0);

/// Shading is drawn linearly over this range, the same in every frame.
const SHADING_RANGE: Range = Range { black: 0.0, white: 1.0 };

pub fn folder(buffer: Buffer) -> String {
    buffer.to_possible_value().expect("no buffer is hidden").get_name().to_owned()
}

pub fn of(buffer: Buffer, pipeline: &Pipeline) -> Option<Image<[u8; 3]>> {
    let depth = |image: &Image<f32>| depth_picture(image, DEPTH_RANGE_M.0, DEPTH_RANGE_M.1);
    let shading = |rgb: &Image<[f32; 3]>| {
        let luminances = rgb.as_slice().iter().map(|&v| luminance(v)).collect();
        value_picture(&Image::from_vec(rgb.size(), luminances), SHADING_RANGE)
    };
    Some(match buffer {
        Buffer::SensorDepth => depth(&pipeline.frame().depth_m),
        Buffer::ModelDepth => depth(&pipeline.model()?.depth_m),
        Buffer::Depth => depth(&pipeline.geometry()?.0.depth_m),
        Buffer::Normals => normal_picture(&pipeline.geometry()?.1.normals),
        Buffer::Origin => origin_picture(&pipeline.geometry()?.1.origin),
        Buffer::Shading => shading(&pipeline.shading()?.real),
        Buffer::VirtualShading => shading(&pipeline.shading()?.merged),
    })
}
