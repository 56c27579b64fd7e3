//! Numbers as the texels of array textures.

use half::f16;

use crate::{Error, Result};

/// What a number of a texel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::renderers) enum Format {
    /// Half precision.
    Half,
    /// 8 bits, read as 0 to 1.
    Byte,
    /// Single precision.
    Single,
}

impl Format {
    /// The name of a texture of four such numbers in WebGPU.
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "rgba16float",
            Self::Byte => "rgba8unorm",
            Self::Single => "rgba32float",
        }
    }

    fn texel_bytes(self) -> usize {
        match self {
            Self::Half => 8,
            Self::Byte => 4,
            Self::Single => 16,
        }
    }
}

/// Side of a layer, which every WebGL2 allows, and number of layers, which every WebGPU allows; powers of two.
const SIDE: usize = 2048;
const LAYERS: usize = 256;

/// An array texture under construction. Texels have addresses: along rows, then row by row, then layer by layer.
#[derive(Debug)]
pub(in crate::renderers) struct Bank {
    pub name: &'static str,
    pub format: Format,
    bytes: Vec<u8>,
}

impl Bank {
    pub fn new(name: &'static str, format: Format) -> Self {
        Self { name, format, bytes: Vec::new() }
    }

    /// Appends numbers, padded to whole texels, and returns the address of the first.
    pub fn push(&mut self, numbers: impl IntoIterator<Item = f32>) -> usize {
        let address = self.texels();
        for number in numbers {
            match self.format {
                Format::Half => self.bytes.extend(f16::from_f32(number).to_le_bytes()),
                Format::Byte => self.bytes.push(number as u8),
                Format::Single => self.bytes.extend(number.to_le_bytes()),
            }
        }
        self.bytes.resize(self.bytes.len().next_multiple_of(self.format.texel_bytes()), 0);
        address
    }

    fn texels(&self) -> usize {
        self.bytes.len() / self.format.texel_bytes()
    }

    /// The numbers of a texel, as a shader reads them.
    pub fn texel(&self, address: usize) -> [f32; 4] {
        let size = self.format.texel_bytes();
        // what is left of the texture is 0
        let Some(bytes) = self.bytes.get(address * size..(address + 1) * size) else { return [0.0; 4] };
        std::array::from_fn(|k| match self.format {
            Format::Half => f16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]).to_f32(),
            Format::Byte => f32::from(bytes[k]) / 255.0,
            Format::Single => f32::from_le_bytes([0, 1, 2, 3].map(|b| bytes[4 * k + b])),
        })
    }

    /// Width, height and number of layers. Width and height are powers of two.
    pub fn size(&self) -> [usize; 3] {
        let texels = self.texels().max(1);
        let width = texels.isqrt().next_power_of_two().min(SIDE);
        let height = texels.div_ceil(width).next_power_of_two().min(SIDE);
        [width, height, texels.div_ceil(width * height)]
    }

    /// Width and number of rows, powers of two, of one picture of all texels.
    pub fn sides(&self) -> [usize; 2] {
        let texels = self.texels().max(1);
        let width = texels.isqrt().next_power_of_two();
        [width, texels.div_ceil(width).next_power_of_two()]
    }

    /// Checks that the texture is not too large.
    ///
    /// # Errors
    /// [`Error::Unsupported`].
    pub fn check(&self, path: &std::path::Path) -> Result<()> {
        let [width, height, layers] = self.size();
        if layers <= LAYERS {
            return Ok(());
        }
        let problem = format!(
            "its {} need {layers} layers of {width} x {height} texels; array textures have {LAYERS}",
            self.name
        );
        Err(Error::unsupported(path, problem))
    }

    /// All bytes of the texture.
    pub fn into_bytes(mut self) -> Vec<u8> {
        let texels = self.size().iter().product::<usize>();
        self.bytes.resize(texels * self.format.texel_bytes(), 0);
        self.bytes
    }
}
