//! The folder of a shader: its textures, their description, and the page that shows the material.

use std::fs;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::{Language, Shader};
use crate::output::failed;
use crate::progress::{Progress, Task};
use crate::renderers::{MANIFEST, scene};
use crate::{Error, Result, codec::CompressedBtf};

/// What differs from one shading language to the other.
pub(in crate::renderers) struct Layout {
    pub language: Language,
    /// Ending of the files with functions.
    pub ending: &'static str,
    /// Before and after the functions of the material: how textures are read.
    pub head: &'static str,
    pub tail: &'static str,
    /// Before the functions of lights, if the target wants them: what they ask for.
    pub lights_head: Option<&'static str>,
    /// How the page draws.
    pub page: &'static Page,
    /// Text of README.md.
    pub readme: &'static str,
}

/// How a page draws.
pub(in crate::renderers) struct Page {
    pub language: Language,
    /// As of [`Layout`].
    pub head: &'static str,
    pub lights_head: &'static str,
    /// The script that draws.
    pub engine: &'static str,
}

/// Writes shader, textures, page and instructions of the material called `name`.
///
/// # Errors
/// As [`Shader::new`]; [`Error::Io`]; [`Error::Cancelled`].
pub(in crate::renderers) fn write(
    layout: &Layout,
    name: &str,
    material: &CompressedBtf,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    let task = Task::new(progress, "export", 2);
    let shader = Shader::new(material.path(), material)?;
    task.advance(1)?;
    let put = |file: &str, bytes: &[u8]| {
        let path = folder.join(file);
        fs::write(&path, bytes).map_err(failed(&path))
    };
    let functions = shader.functions(layout.language, layout.head, layout.tail);
    put(&format!("material.{}", layout.ending), functions.as_bytes())?;
    if let Some(head) = layout.lights_head {
        put(&format!("lights.{}", layout.ending), shader.lights(layout.language, head).as_bytes())?;
    }
    let page = layout.page;
    let drawn = [
        shader.functions(page.language, page.head, ""),
        shader.lights(page.language, page.lights_head),
        shader.scene(page.language),
    ];
    let loss = shader.loss;
    let (mut textures, mut contents) = (Vec::new(), Vec::new());
    for bank in shader.banks {
        let (name, format, size) = (bank.name, bank.format, bank.size());
        let file = format!("{name}.bin");
        let bytes = bank.into_bytes();
        put(&file, &bytes)?;
        textures.push(json!({
            "name": name, "file": file, "format": format.name(), "size": size, "bytes": bytes.len(),
        }));
        contents.push((name, bytes));
    }
    let description = json!({
        "name": name,
        "loden": env!("CARGO_PKG_VERSION"),
        "textures": textures,
        "half_precision": loss,
        "recipe": material.parts().recipe(),
    });
    let text = serde_json::to_string_pretty(&description).map_err(|e| Error::io(folder)(e.into()))? + "\n";
    put(MANIFEST, text.as_bytes())?;
    put("index.html", html(name, &drawn.join("\n"), page.engine, &textures, &contents).as_bytes())?;
    let readme = loss.filled(&scene::filled(&layout.readme.replace("{name}", name)));
    put("README.md", readme.as_bytes())?;
    task.advance(1)
}

/// A page that needs no other file.
fn html(name: &str, shader: &str, engine: &str, textures: &[Value], contents: &[(&str, Vec<u8>)]) -> String {
    let data: serde_json::Map<String, Value> =
        contents.iter().map(|(name, bytes)| ((*name).to_owned(), Value::String(STANDARD.encode(bytes)))).collect();
    // a script must not contain what would end it
    let json = |value: &Value| value.to_string().replace("</", "<\\/");
    let script = scene::filled(include_str!("page.js"))
        .replace("{TEXTURES}", &json(&Value::Array(textures.to_vec())))
        .replace("{SHADER}", &json(&Value::String(shader.into())))
        .replace("{DATA}", &json(&Value::Object(data)))
        .replace("{ENGINE}", engine);
    include_str!("page.html").replace("{NAME}", &escaped(name)).replace("{SCRIPT}", &script)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
