"""Where a training is logged: TorchRL's loggers, chosen by ``logger=``; ``conf/logger/*.yaml`` explains the values."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from auv_torchrl.settings import OneOf, check_fields

if TYPE_CHECKING:  # the command line needs the settings alone
    from torch import Tensor

LOGGERS = {  # by name: the modules that its scalars need, and those of a video
    "none": ((), ()),
    "csv": ((), ("torchcodec",)),
    "tensorboard": (("tensorboard",), ("moviepy.editor",)),
    "wandb": (("wandb",), ("moviepy",)),
    "mlflow": (("mlflow",), ("torchcodec",)),
}
BROUGHT_BY = {"moviepy.editor": "'moviepy<2'"}  # torch writes TensorBoard's videos by what moviepy 2 has no more
PROJECT = "auv_torchrl"  # by which Weights & Biases and MLflow know the trainings


@dataclass(frozen=True)
class LoggerConfig:
    """Which logger, and whether it gets a video of the trained policy.

    Raises:
        ValueError: for an unknown logger, or a package that it needs and that is not installed.
    """

    name: Annotated[str, OneOf(tuple(LOGGERS))] = "none"
    video: bool = False

    def __post_init__(self) -> None:
        """Refuse what could not be logged, before anything is trained."""
        check_fields(self, "logger")
        if self.video and self.name == "none":
            raise ValueError("logger.video is true, and logger=none keeps no video: choose another logger")
        scalars, videos = LOGGERS[self.name]
        for module in (*scalars, *(videos if self.video else ())):
            if not is_there(module):
                asks = "logger.video=true with " if module in videos else ""
                raise ValueError(
                    f"{asks}logger={self.name} needs {module}, which is not installed: pip install "
                    f"{BROUGHT_BY.get(module, module)}"
                )


def is_there(module: str) -> bool:
    """Whether a module is installed; it is not imported."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # not even the package that it is a part of
        return False


class TrainingLog:
    """The learning curve of one training in a TorchRL logger, and a video if it is wanted.

    A training that is killed and resumed logs the last point again; at its number of transitions stands the same value.

    Args:
        config: which logger.
        folder: of the training; files go there, but for MLflow, whose database has all trainings of the store.
        key: hash of the training, by which Weights & Biases goes on with it.
    """

    def __init__(self, config: LoggerConfig, folder: Path, key: str):
        self.video = config.video
        self._logger = _make(config.name, folder, key)

    def point(self, values: Mapping[str, float]) -> None:
        """Log a row of the learning curve."""
        if self._logger is not None:
            for name, value in values.items():
                if name != "frames":
                    self._logger.log_scalar(f"train/{name}", value, step=int(values["frames"]))

    def film(self, frames: "Tensor", per_second: float, step: int) -> None:
        """Log pictures (T, 3, height, width), uint8."""
        if self._logger is not None:
            self._logger.log_video("flight", frames[None], step=step, fps=round(per_second))

    def close(self) -> None:
        """Write what is pending."""
        if self._logger is not None:
            self._logger.close()
            for end in ("close", "finish"):  # of TensorBoard's writer, of a run of Weights & Biases
                getattr(self._logger.experiment, end, lambda: None)()


def _make(name: str, folder: Path, key: str) -> Any:
    """A TorchRL logger; None for ``none``. They are imported here: not every command trains."""
    if name == "none":
        return None
    from torchrl.record.loggers import csv, mlflow, tensorboard, wandb

    makers: dict[str, Any] = {
        "csv": lambda: csv.CSVLogger("csv", log_dir=str(folder), video_format="mp4"),
        "tensorboard": lambda: tensorboard.TensorboardLogger("tensorboard", log_dir=str(folder)),
        "wandb": lambda: wandb.WandbLogger(key, log_dir=str(folder), id=key, project=PROJECT),
        "mlflow": lambda: mlflow.MLFlowLogger(
            PROJECT,
            tracking_uri=f"sqlite:///{folder.parent.absolute()}/mlflow.db",
            artifact_location=(folder.parent.absolute() / "mlflow").as_uri(),
        ),
    }
    return makers[name]()
