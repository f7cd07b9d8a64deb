"""Form of materials and characteristics in any kind of file."""

import re
from typing import Any

from flexstage.base.choose import unknown
from flexstage.base.errors import FlexstageError
from flexstage.files.decoder import Decoder
from flexstage.files.encoder import Encoder
from flexstage.files.format import DIMENSION_OF_UNIT, Form
from flexstage.files.nodes import Mapping, Node
from flexstage.quantities.characteristic import ORIGINS, Characteristic
from flexstage.quantities.material import CATALOGUE, Material, material
from flexstage.quantities.quantity import QUANTITIES
from flexstage.quantities.units import DIMENSIONS, to_text


def _read_material(decoder: Decoder, node: Node, path: str, base: Any) -> Material:
    if isinstance(node, Mapping):
        return decoder.build(Material, node, path, base=base)
    name = decoder.text(node, path)
    try:
        return material(name)
    except FlexstageError as error:
        decoder.refuse_again(node, path, error)


def _write_material(encoder: Encoder, value: Material) -> Any:
    return value.name if CATALOGUE.get(value.name) == value else encoder.fields(value)


def _material_schema(builder: Any) -> dict[str, Any]:
    # names of the catalogue are not case-sensitive
    pattern = (
        "|".join(
            "".join(f"[{c.upper()}{c.lower()}]" if c.isalpha() else re.escape(c) for c in name)
            for name in CATALOGUE
        )
        .replace(r"\ ", " ")
        .replace(r"\-", "-")
        .replace(r"\<", "<")
        .replace(r"\>", ">")
    )
    return {
        "anyOf": [
            {"enum": list(CATALOGUE)},
            {"type": "string", "pattern": f"^({pattern})$"},
            builder.describe(Material, named=True),
        ]
    }


def _read_characteristic(decoder: Decoder, node: Node, path: str, _base: Any) -> Characteristic:
    entry = decoder.mapping(node, path)
    quantity = entry.items.get("quantity")
    name = decoder.text(quantity, f"{path}.quantity") if quantity else ""
    if quantity is not None and name not in QUANTITIES:
        sentence = unknown("quantity", name, QUANTITIES, 0.5)
        decoder.refuse(quantity, f"{path}.quantity", sentence)
    unit = QUANTITIES[name].unit if name in QUANTITIES else "1"
    fields: dict[str, Any] = {"unit": unit}
    for key in ("value", "uncertainty"):
        value = entry.items.get(key)
        if value is not None and unit != "1":
            dimension = DIMENSIONS[DIMENSION_OF_UNIT[unit]]
            fields[key] = decoder.quantity(dimension, value, f"{path}.{key}")
    others = {k: v for k, v in entry.items.items() if k not in fields or k == "unit"}
    return decoder.build(Characteristic, Mapping(entry.line, others, entry.key_lines), path, fields)


def _write_characteristic(encoder: Encoder, value: Characteristic) -> dict[str, Any]:
    out = encoder.fields(value, skip="unit")
    if value.unit != "1":
        for key in ("value", "uncertainty"):
            if (quantity_value := getattr(value, key)) is not None:
                out[key] = to_text(quantity_value, DIMENSION_OF_UNIT[value.unit])
    return out


def _characteristic_schema(builder: Any) -> dict[str, Any]:
    out = builder.describe(Characteristic)
    del out["properties"]["unit"]
    out["required"] = [name for name in out["required"] if name != "unit"]
    out["properties"]["quantity"] = {"enum": list(QUANTITIES)}
    out["properties"]["origin"] = {"enum": list(ORIGINS)}
    for name in ("value", "uncertainty"):
        text = {"type": ["string", "number"], "description": "With its unit, if it has one."}
        out["properties"][name] = text
    return out


#: Forms of materials and characteristics.
FORMS: dict[Any, Form] = {
    Material: Form(read=_read_material, write=_write_material, schema=_material_schema),
    Characteristic: Form(
        read=_read_characteristic, write=_write_characteristic, schema=_characteristic_schema
    ),
}
