"""What is recorded, and how much of it."""

from typing import Literal

from pydantic import Field

from followerd.settings import Settings


class RecordSettings(Settings):
    """Inputs, decisions and images, as MCAP files that Foxglove shows."""

    folder: str | None = Field(
        None, description="for recordings that are not given a name; default: the state directory"
    )
    images: Literal["exact", "jpeg", "none"] = Field(
        "jpeg", description="exact: a replay is identical to the bit; jpeg: a twentieth of the size"
    )
    jpeg_quality: int = Field(85, ge=1, le=100)
    raw_bytes: bool = Field(False, description="also what the serial devices said, byte by byte")
    max_file_mb: float = Field(1000.0, gt=0, description="after which a new file is begun")
    min_free_mb: float = Field(500.0, ge=0, description="left on the disk when recording stops")
    flush_s: float = Field(0.5, gt=0, le=1, description="at most so much is lost when killed")
    queue: int = Field(4000, ge=100, description="records that may wait for the disk")
    queued_images: int = Field(15, ge=1, description="images among them, beyond which they go")
    foxglove_port: int | None = Field(
        None, ge=0, le=65535, description="serve what happens to Foxglove on 127.0.0.1"
    )
