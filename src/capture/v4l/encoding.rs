//! Which YCbCr and which RGB a driver gives.

#![allow(unsafe_code, reason = "calls of the kernel")]

use crate::capture::pixel_formats::PixelFormat;
use v4l::v4l_sys as sys;

/// # Errors
/// It is another than is read: names both.
pub fn check(format: PixelFormat, pix: &sys::v4l2_pix_format) -> Result<(), String> {
    match (format, is_full_range(format, pix)) {
        // A JPEG says itself what it holds.
        (PixelFormat::Mjpeg, _) => Ok(()),
        (PixelFormat::Rgb24 | PixelFormat::Bgr24, true) => Ok(()),
        (PixelFormat::Rgb24 | PixelFormat::Bgr24, false) => {
            Err(format!("{format} from 16 to 235, where 0 to 255 is read"))
        }
        (_, full) => {
            let standard = standard(pix);
            let range = if full { "full" } else { "limited" };
            match (standard, full) {
                ("BT.601", false) => Ok(()),
                _ => Err(format!(
                    "{format} by {standard} in {range} range, where BT.601 in limited range is read"
                )),
            }
        }
    }
}

/// By the kernel's rule for what drivers leave open.
fn is_full_range(format: PixelFormat, pix: &sys::v4l2_pix_format) -> bool {
    match pix.quantization {
        sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE => true,
        sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE => false,
        _ => !format.is_ycbcr() || pix.colorspace == sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG,
    }
}

fn standard(pix: &sys::v4l2_pix_format) -> &'static str {
    // SAFETY: a number in either member.
    let encoding = unsafe { pix.__bindgen_anon_1.ycbcr_enc };
    match (encoding, pix.colorspace) {
        (sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_DEFAULT, colorspace) => match colorspace {
            sys::v4l2_colorspace_V4L2_COLORSPACE_REC709
            | sys::v4l2_colorspace_V4L2_COLORSPACE_DCI_P3 => "BT.709",
            sys::v4l2_colorspace_V4L2_COLORSPACE_BT2020 => "BT.2020",
            sys::v4l2_colorspace_V4L2_COLORSPACE_SMPTE240M => "SMPTE 240M",
            _ => "BT.601",
        },
        (
            sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_601
            | sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_SYCC,
            _,
        ) => "BT.601",
        (sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_709, _) => "BT.709",
        _ => "another standard",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::v4l::node::zeroed;

    fn pix(colorspace: u32, ycbcr_enc: u32, quantization: u32) -> sys::v4l2_pix_format {
        let format: sys::v4l2_format = zeroed();
        // SAFETY: numbers in any member.
        let mut pix = unsafe { format.fmt.pix };
        pix.colorspace = colorspace;
        pix.__bindgen_anon_1.ycbcr_enc = ycbcr_enc;
        pix.quantization = quantization;
        pix
    }

    #[test]
    fn webcams_pass_and_what_would_be_read_wrongly_does_not() {
        const SRGB: u32 = sys::v4l2_colorspace_V4L2_COLORSPACE_SRGB;
        const JPEG: u32 = sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG;
        const REC709: u32 = sys::v4l2_colorspace_V4L2_COLORSPACE_REC709;
        const FULL: u32 = sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE;
        const LIMITED: u32 = sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE;
        let said = |format, pix| check(format, &pix).err().unwrap_or_default();
        for colorspace in [0, SRGB, sys::v4l2_colorspace_V4L2_COLORSPACE_SMPTE170M] {
            assert_eq!(said(PixelFormat::Yuyv, pix(colorspace, 0, 0)), "");
        }
        assert_eq!(said(PixelFormat::Nv12, pix(REC709, 1, LIMITED)), "");
        assert!(said(PixelFormat::Nv12, pix(REC709, 0, 0)).contains("BT.709 in limited range"));
        assert!(said(PixelFormat::Yuyv, pix(SRGB, 2, 0)).contains("BT.709"));
        assert!(said(PixelFormat::Yuyv, pix(JPEG, 0, 0)).contains("BT.601 in full range"));
        assert!(said(PixelFormat::Uyvy, pix(SRGB, 0, FULL)).contains("full range"));
        assert!(said(PixelFormat::Uyvy, pix(SRGB, 99, 0)).contains("another standard"));
        for format in [PixelFormat::Rgb24, PixelFormat::Bgr24] {
            assert_eq!(said(format, pix(SRGB, 0, 0)), "");
            assert!(said(format, pix(SRGB, 0, LIMITED)).contains("from 16 to 235"));
        }
        assert_eq!(said(PixelFormat::Mjpeg, pix(JPEG, 2, LIMITED)), "");
    }
}
