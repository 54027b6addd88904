//! The files of the scene of a session, as they stand: what a replay is run with, wherever and whenever it is.

use crate::channels::Channel;
use crate::checkpoint::CHANNEL_BYTES;
use crate::error::ReadError;
use crate::reader::Reader;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use mcap::records::op;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::path::Path;

/// The time of their messages, ticks: before a station's first, so that whoever plays a file back has them.
pub(crate) const TICK: u64 = 1;

/// A file, one of so many.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneFile {
    /// Which of them, from 0; the first one is the scene.
    pub index: u32,
    /// How many there are.
    pub count: u32,
    /// Its name as the scene has it, relative to the scene's folder.
    pub name: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// Message of `/scene`.
#[derive(Serialize, Deserialize)]
pub(crate) struct SceneMessage {
    index: u32,
    count: u32,
    name: String,
    data: String,
}

impl SceneMessage {
    pub(crate) fn of(file: &SceneFile) -> SceneMessage {
        let SceneFile { index, count, name, bytes } = file;
        SceneMessage { index: *index, count: *count, name: name.clone(), data: BASE64_STANDARD.encode(bytes) }
    }
    pub(crate) fn file(self) -> Result<SceneFile, String> {
        let SceneMessage { index, count, name, data } = self;
        let bytes = BASE64_STANDARD.decode(data).map_err(|error| format!("has a file of the scene that is none: {error}"))?;
        Ok(SceneFile { index, count, name, bytes })
    }
}

/// The files of a recording's scene, in their order; none where they are not all there.
pub fn scene_files(path: &Path) -> Result<Vec<SceneFile>, ReadError> {
    Reader::open(path)?.scene_files()
}

impl<R: Read + Seek> Reader<R> {
    fn scene_files(&mut self) -> Result<Vec<SceneFile>, ReadError> {
        let (mut files, mut chunk) = (BTreeMap::<u32, SceneFile>::new(), None);
        while let Some(frame) = self.next_frame()? {
            match frame.opcode {
                op::CHUNK => chunk = Some(frame),
                op::MESSAGE_INDEX => {
                    let head = self.body(&frame, CHANNEL_BYTES)?;
                    let is_scene = head[..] == (Channel::Scene as u16).to_le_bytes();
                    let Some(chunk) = chunk.take_if(|_| is_scene) else { continue };
                    let Ok(block) = self.block_at(&chunk)? else { continue }; // damaged
                    files.extend(block.scene.into_iter().map(|file| (file.index, file)));
                    let whole = files.last_key_value().map(|(index, file)| (*index as usize + 1, file.count as usize));
                    if whole == Some((files.len(), files.len())) {
                        return Ok(files.into_values().collect());
                    }
                }
                op::DATA_END => break,
                _ => {}
            }
        }
        Ok(Vec::new())
    }
}
