//! Buffers of the pipeline as viewable pictures, for `--dump`.

use super::args::Buffer as Asked;
use clap::ValueEnum;
use kinlight::image::Image;
use kinlight::math::color::luminance;
use kinlight::output::{Range, depth_picture, normal_picture, origin_picture, value_picture};
use kinlight::pipeline::{Backend, Buffer, BufferValues, PipelineError};

/// Depth is drawn from near (bright) to far over this range, metres, the same in every frame.
const DEPTH_RANGE_M: (f32, f32) = (0.3, 4.0);

/// Shading is drawn linearly over this range, the same in every frame.
const SHADING_RANGE: Range = Range { black: 0.0, white: 1.0 };

pub fn folder(buffer: Asked) -> String {
    buffer.to_possible_value().expect("no buffer is hidden").get_name().to_owned()
}

pub fn of(asked: Asked, pipeline: &dyn Backend) -> Result<Option<Image<[u8; 3]>>, PipelineError> {
    let buffer = match asked {
        Asked::SensorDepth => Buffer::SensorDepth,
        Asked::ModelDepth => Buffer::ModelDepth,
        Asked::Depth => Buffer::Depth,
        Asked::Normals => Buffer::Normals,
        Asked::Origin => Buffer::Origin,
        Asked::Shading => Buffer::Shading,
        Asked::VirtualShading => Buffer::VirtualShading,
    };
    Ok(pipeline.buffer(buffer)?.map(|values| match values {
        BufferValues::DepthM(depth_m) => depth_picture(&depth_m, DEPTH_RANGE_M.0, DEPTH_RANGE_M.1),
        BufferValues::Normals(normals) => normal_picture(&normals),
        BufferValues::Origins(origins) => origin_picture(&origins),
        BufferValues::Light(rgb) => {
            let luminances = rgb.as_slice().iter().map(|&v| luminance(v)).collect();
            value_picture(&Image::from_vec(rgb.size(), luminances), SHADING_RANGE)
        }
    }))
}
