//! Binary glTF: a JSON chunk, and one buffer with everything else.

use serde_json::{Value, json};

/// Pieces of the buffer, and the tables of the document that name them.
#[derive(Default)]
pub(super) struct Glb {
    buffer: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
}

impl Glb {
    /// Adds bytes, with what graphics cards use them for if they are numbers; the index of their view. Every piece begins at a
    /// multiple of four.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.buffer.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.buffer.extend_from_slice(bytes);
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        self.views.len() - 1
    }

    /// Adds numbers of a component type of glTF; the index of their accessor.
    pub(super) fn accessor(
        &mut self,
        bytes: &[u8],
        kind: &str,
        component: u32,
        count: usize,
        range: Option<Value>,
    ) -> usize {
        /// For vertices, and for indices.
        const TARGETS: [u32; 2] = [34962, 34963];
        let view = self.view(bytes, Some(TARGETS[usize::from(kind == "SCALAR")]));
        let mut accessor = json!({ "bufferView": view, "type": kind, "componentType": component, "count": count });
        if let (Some(Value::Object(range)), Value::Object(all)) = (range, &mut accessor) {
            all.extend(range);
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a PNG file as a texture that repeats; its index.
    pub(super) fn texture(&mut self, name: &str, png: &[u8]) -> usize {
        let view = self.view(png, None);
        self.images.push(json!({ "name": name, "bufferView": view, "mimeType": "image/png" }));
        self.images.len() - 1
    }

    /// The file, with the tables put into `document`.
    pub(super) fn into_bytes(mut self, mut document: Value) -> Vec<u8> {
        /// Linear filters, with mip maps between which is interpolated; repeated.
        const SAMPLER: [u32; 3] = [9729, 9987, 10497];
        let textures: Vec<Value> = (0..self.images.len()).map(|k| json!({ "source": k, "sampler": 0 })).collect();
        let [magnify, minify, wrap] = SAMPLER;
        document["buffers"] = json!([{ "byteLength": self.buffer.len() }]);
        document["bufferViews"] = self.views.into();
        document["accessors"] = self.accessors.into();
        document["images"] = self.images.into();
        document["textures"] = textures.into();
        document["samplers"] = json!([{ "magFilter": magnify, "minFilter": minify, "wrapS": wrap, "wrapT": wrap }]);
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        let whole = 12 + 8 + text.len() + 8 + self.buffer.len();
        let word = |number: usize| (number as u32).to_le_bytes();
        let header = [*b"glTF", word(2), word(whole), word(text.len()), *b"JSON"].concat();
        [header, text, word(self.buffer.len()).to_vec(), b"BIN\0".to_vec(), self.buffer].concat()
    }
}
