//! Images (glTF 2.0, 3.8.3) as textures, each decoded once.

use std::collections::HashMap;
use std::path::Path;

use super::super::error::MeshError;
use super::super::grow;
use super::super::shown::shown;
use super::super::source::read_file;
use super::super::{texture, uri};
use super::document::Document;
use super::json::Image;
use pipeline::scene::description::Texture;

/// sRGB code of linear 0.8: 255·(1.055·0.8^(1/2.4) − 0.055).
const GREY_CODE: u8 = 231;

/// Memory of what is kept of an image beside its texels: names, a note, a source file.
const IMAGE_BYTES: u64 = 1 << 12;

/// The textures of a file that are in use.
pub(super) struct Images<'d, 'a> {
    document: &'d Document<'a>,
    textures: Vec<Texture>,
    /// Number in `textures` of an image; of a texture without an image under `None`.
    numbers: HashMap<Option<usize>, usize>,
}

impl<'d, 'a> Images<'d, 'a> {
    pub(super) fn new(document: &'d Document<'a>) -> Self {
        Self { document, textures: Vec::new(), numbers: HashMap::new() }
    }

    /// Number in the scene of the texture `number` of the file, which exists.
    ///
    /// # Errors
    /// It has no image, or one that is missing, refused or does not decode.
    pub(super) fn texture(&mut self, number: usize) -> Result<usize, MeshError> {
        let json = &self.document.json.textures[number];
        let place = || format!("textures[{number}]");
        let image = match (json.extensions.webp.source.or(json.source), json.extensions.basisu.source) {
            (Some(source), _) => {
                Some(self.document.object(&self.document.json.images, source, "images", &|| {
                    format!("{}.source", place())
                })?)
            }
            (None, Some(_)) => {
                return Err(MeshError::Unsupported {
                    path: self.document.context.path.into(),
                    place: place(),
                    found: "a KTX2 picture (KHR_texture_basisu) without another".into(),
                    way_out: "convert it to PNG, JPEG or WebP".into(),
                });
            }
            (None, None) => None,
        };
        let key = image.map(|(index, _)| index);
        if let Some(&known) = self.numbers.get(&key) {
            return Ok(known);
        }
        let texture = match image {
            Some((index, image)) => self.decoded(index, image)?,
            None if self.document.context.limits.missing_textures_grey => self.grey(&place()),
            None => {
                let expected = "a source; or give --missing-textures grey";
                return Err(self.document.context.invalid(place(), expected, "none"));
            }
        };
        let known = self.textures.len();
        self.textures.push(texture);
        self.numbers.insert(key, known);
        Ok(known)
    }

    /// All of them.
    pub(super) fn finish(self) -> Vec<Texture> {
        self.textures
    }

    fn decoded(&self, index: usize, image: &Image<'_>) -> Result<Texture, MeshError> {
        let (context, place) = (self.document.context, format!("images[{index}]"));
        let uri = image.uri.as_ref().map(|text| &*text.0);
        let file_name = uri.filter(|uri| !uri::is_data(uri));
        let name =
            image.name.as_deref().or(file_name).map_or_else(|| format!("image {index}"), str::to_owned);
        match (uri, image.buffer_view) {
            (None, None) => Err(context.invalid(place, "a uri or a bufferView", "neither")),
            (_, Some(view)) => {
                let view = self.document.view(view, &|| format!("{place}.bufferView"))?;
                texture::decode(context, context.path, &place, name, view.bytes)
            }
            (Some(uri), None) if uri::is_data(uri) => {
                let bytes = uri::decode_data(context, &place, uri)?;
                let texture = texture::decode(context, context.path, &place, name, &bytes);
                context.release(bytes.len() as u64);
                texture
            }
            (Some(uri), None) => {
                context.charge(IMAGE_BYTES, || place.clone())?;
                let file = uri::find(context, &place, uri)?;
                match file.opened {
                    Some(opened) => self.decode_file(&file.named, &opened, &place, name),
                    None if context.limits.missing_textures_grey => Ok(self.grey(&shown(uri))),
                    None => {
                        let way_out = "copy it there, or give --missing-textures grey";
                        let path = context.path.into();
                        Err(MeshError::Missing { path, place, file: file.named, way_out })
                    }
                }
            }
        }
    }

    fn decode_file(
        &self,
        named: &Path,
        opened: &Path,
        place: &str,
        name: String,
    ) -> Result<Texture, MeshError> {
        let context = self.document.context;
        let bytes = read_file(context, named, opened)?;
        let texture = texture::decode(context, named, place, name, &bytes);
        grow::free(context, bytes);
        texture
    }

    /// One grey texel instead of a missing texture.
    fn grey(&self, name: &str) -> Texture {
        self.document.context.note(format!("missing texture {name} read as grey, 0.8"));
        Texture {
            name: name.into(),
            width: 1,
            height: 1,
            texels: vec![[GREY_CODE, GREY_CODE, GREY_CODE, 255]],
        }
    }
}
