//! Nodes of a scene depth first, with their matrices in the world.
//!
//! The nodes are disjoint strict trees (glTF 2.0, 3.5.1): each has at most one parent, and none is its own ancestor.

use super::super::error::MeshError;
use super::super::shown::shown;
use super::document::Document;
use super::matrix::{self, IDENTITY, Matrix};

/// Maximum number of nodes from a root to a leaf.
const MAX_DEPTH: usize = 1000;

/// A node in its place.
pub(super) struct Placed {
    /// Its number.
    pub(super) node: usize,
    pub(super) to_world: Matrix,
}

/// The nodes of the default scene, else of the first, else all.
///
/// # Errors
/// A number of no node or scene; a node with two parents; a cycle; a root of a scene with a parent; more than [`MAX_DEPTH`] nodes from
/// root to leaf; matrices that are not finite.
pub(super) fn nodes(document: &Document<'_>) -> Result<Vec<Placed>, MeshError> {
    let (json, context) = (&document.json, document.context);
    context.charge((json.nodes.len() * 3 * size_of::<Placed>()) as u64, || "its nodes".into())?;
    let parents = parents(document)?;
    check_cycles(document, &parents)?;
    let mut stack: Vec<(usize, usize, Matrix)> = Vec::new();
    let mut is_root = vec![false; json.nodes.len()];
    for root in roots(document, &parents)? {
        if std::mem::replace(&mut is_root[root], true) {
            return Err(context.invalid("scenes", "each root node once", format!("nodes[{root}] twice")));
        }
        stack.push((root, 1, IDENTITY));
    }
    stack.reverse();
    let mut placed = Vec::new();
    while let Some((number, depth, parent)) = stack.pop() {
        let node = &json.nodes[number];
        if depth > MAX_DEPTH {
            let expected = format!("at most {MAX_DEPTH} nodes from root to leaf");
            return Err(context.invalid(format!("nodes[{number}]"), expected, "more"));
        }
        let to_world = matrix::product(&parent, &matrix::of_node(context, number, node)?);
        if !to_world.as_flattened().iter().all(|v| v.is_finite()) {
            let found = "NaN or infinity in the product with its parents";
            return Err(context.invalid(format!("nodes[{number}]"), "a finite matrix", found));
        }
        // In range: checked with the parents.
        stack.extend(
            node.children.iter().rev().filter_map(|&c| Some((usize::try_from(c).ok()?, depth + 1, to_world))),
        );
        placed.push(Placed { node: number, to_world });
    }
    Ok(placed)
}

/// Root nodes to read, in order.
fn roots(document: &Document<'_>, parents: &[Option<usize>]) -> Result<Vec<usize>, MeshError> {
    let (json, context) = (&document.json, document.context);
    if json.scenes.is_empty() && json.scene.is_none() {
        return Ok((0..parents.len()).filter(|&node| parents[node].is_none()).collect());
    }
    let (number, scene) = match (json.scene, json.scenes.is_empty()) {
        // A number of a scene in a file without scenes: all nodes are read.
        (Some(_), true) => return Ok((0..parents.len()).filter(|&node| parents[node].is_none()).collect()),
        (number, _) => {
            document.object(&json.scenes, number.unwrap_or_default(), "scenes", &|| "scene".into())?
        }
    };
    if json.scenes.len() > 1 {
        let name = scene.name.as_deref().map_or_else(String::new, |name| format!(" ({})", shown(name)));
        context.note(format!("of {} scenes number {number}{name} is read", json.scenes.len()));
    }
    let root = |(k, &node): (usize, &u64)| {
        let place = || format!("scenes[{number}].nodes[{k}]");
        let (node, _) = document.object(&json.nodes, node, "nodes", &place)?;
        match parents[node] {
            None => Ok(node),
            Some(parent) => {
                let found = format!("nodes[{node}], a child of nodes[{parent}]");
                Err(context.invalid(place(), "a node without a parent", found))
            }
        }
    };
    scene.nodes.iter().enumerate().map(root).collect()
}

/// Parent of each node.
fn parents(document: &Document<'_>) -> Result<Vec<Option<usize>>, MeshError> {
    let nodes = &document.json.nodes;
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for (k, &child) in node.children.iter().enumerate() {
            let place = || format!("nodes[{parent}].children[{k}]");
            let (child, _) = document.object(nodes, child, "nodes", &place)?;
            if let Some(other) = parents[child].replace(parent) {
                let found = format!("nodes[{child}], which is also a child of nodes[{other}]");
                return Err(document.context.invalid(place(), "a node with one parent", found));
            }
        }
    }
    Ok(parents)
}

/// Looks for a node that is its own ancestor.
fn check_cycles(document: &Document<'_>, parents: &[Option<usize>]) -> Result<(), MeshError> {
    const UNSEEN: usize = usize::MAX;
    // Number of the walk that reached a node first.
    let mut walks = vec![UNSEEN; parents.len()];
    for start in 0..parents.len() {
        let mut next = Some(start);
        while let Some(node) = next {
            if walks[node] == start {
                let found = format!("nodes[{node}] among its own descendants");
                return Err(document.context.invalid(
                    format!("nodes[{node}].children"),
                    "a tree of nodes",
                    found,
                ));
            }
            if walks[node] != UNSEEN {
                break;
            }
            walks[node] = start;
            next = parents[node];
        }
    }
    Ok(())
}
