//! The little of SPIR-V that the build needs: bindings, and the offsets of named block members.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Context, Result, ensure};

/// Member name and byte offset, in declaration order.
pub type Members = Vec<(String, u32)>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    UniformBuffer,
    StorageBuffer,
    SampledImage,
    StorageImage,
    InputAttachment,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binding {
    pub set: u32,
    pub binding: u32,
    pub kind: Kind,
}

#[derive(Debug)]
pub struct Module {
    /// Sorted by set, then binding.
    pub bindings: Vec<Binding>,
    /// Every struct whose members have offsets, by name.
    pub blocks: BTreeMap<String, Members>,
}

// Opcodes, decorations and storage classes: SPIR-V 1.6, sections 3.49, 3.20 and 3.7.
const OP_NAME: u32 = 5;
const OP_MEMBER_NAME: u32 = 6;
const OP_TYPE_IMAGE: u32 = 25;
const OP_TYPE_POINTER: u32 = 32;
const OP_VARIABLE: u32 = 59;
const OP_DECORATE: u32 = 71;
const OP_MEMBER_DECORATE: u32 = 72;
const BINDING: u32 = 33;
const DESCRIPTOR_SET: u32 = 34;
const OFFSET: u32 = 35;
const SUBPASS_DATA: u32 = 6;
const UNIFORM_CONSTANT: u32 = 0;
const UNIFORM: u32 = 2;
const STORAGE_BUFFER: u32 = 12;

impl Module {
    pub fn parse(words: &[u32]) -> Result<Module> {
        ensure!(words.first() == Some(&0x0723_0203), "not SPIR-V");
        let mut names = HashMap::new();
        let mut member_names: BTreeMap<(u32, u32), String> = BTreeMap::new();
        let mut offsets: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut sets = HashMap::new();
        let mut slots = HashMap::new();
        let mut variables = Vec::new();
        // Kinds of image types, and what pointer types point to.
        let mut images = HashMap::new();
        let mut pointers = HashMap::new();

        let mut at = 5;
        while at < words.len() {
            let (length, op) = ((words[at] >> 16) as usize, words[at] & 0xffff);
            ensure!(length > 0 && at + length <= words.len(), "instruction runs past the end at word {at}");
            let operands = &words[at + 1..at + length];
            match (op, operands) {
                (OP_NAME, [id, text @ ..]) => drop(names.insert(*id, string(text))),
                (OP_MEMBER_NAME, [id, member, text @ ..]) => drop(member_names.insert((*id, *member), string(text))),
                (OP_MEMBER_DECORATE, [id, member, OFFSET, offset]) => drop(offsets.insert((*id, *member), *offset)),
                (OP_DECORATE, [id, BINDING, slot]) => drop(slots.insert(*id, *slot)),
                (OP_DECORATE, [id, DESCRIPTOR_SET, set]) => drop(sets.insert(*id, *set)),
                // Operands after the sampled type: dimension, depth, arrayed, multisampled, and whether it is sampled (1) or
                // loaded and stored (2).
                (OP_TYPE_IMAGE, [id, _, dimension, _, _, _, sampled, ..]) => {
                    let kind = match (*dimension, *sampled) {
                        (SUBPASS_DATA, _) => Kind::InputAttachment,
                        (_, 2) => Kind::StorageImage,
                        _ => Kind::SampledImage,
                    };
                    images.insert(*id, kind);
                }
                (OP_TYPE_POINTER, [id, _, to]) => drop(pointers.insert(*id, *to)),
                (OP_VARIABLE, [ty, id, class, ..]) => variables.push((*id, *ty, *class)),
                _ => {}
            }
            at += length;
        }

        let mut bindings = Vec::new();
        for (id, ty, class) in variables {
            let Some(&binding) = slots.get(&id) else { continue };
            let kind = match class {
                UNIFORM => Kind::UniformBuffer,
                STORAGE_BUFFER => Kind::StorageBuffer,
                // An image, or one with its sampler, which is a type of its own.
                UNIFORM_CONSTANT => {
                    pointers.get(&ty).and_then(|to| images.get(to)).copied().unwrap_or(Kind::SampledImage)
                }
                other => anyhow::bail!("binding {binding} has storage class {other}"),
            };
            let set = *sets.get(&id).context("a binding without a set")?;
            bindings.push(Binding { set, binding, kind });
        }
        bindings.sort_by_key(|b| (b.set, b.binding));

        let mut blocks: BTreeMap<String, Members> = BTreeMap::new();
        for ((id, member), offset) in offsets {
            let block = names.get(&id).filter(|n| !n.is_empty()).context("a block without a name")?;
            let name = member_names.get(&(id, member)).context("a block member without a name")?;
            blocks.entry(block.clone()).or_default().push((name.clone(), offset));
        }
        Ok(Module { bindings, blocks })
    }
}

/// A literal string: UTF-8 in little-endian words, ended by a zero byte.
fn string(words: &[u32]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).take_while(|b| *b != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}
