"""Two simulated aircraft, each in its namespace with its own clock: `ros2 launch msls_ros two_aircraft.launch.py`."""

from __future__ import annotations

from pathlib import Path

from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

AIRCRAFT = {
    "left": {"params_file": "f16", "condition": "high_alpha", "manoeuvre": "roll_doublet"},
    "right": {"params_file": "f16", "condition": "cruise", "manoeuvre": "steady"},
}


def generate_launch_description() -> LaunchDescription:
    """Return one closed loop per aircraft."""
    one = PythonLaunchDescriptionSource(str(Path(__file__).parent / "closed_loop.launch.py"))
    duration = DeclareLaunchArgument("duration", default_value="0.0", description="flight time [s]; 0: never ends")
    loops = [
        GroupAction(
            [
                IncludeLaunchDescription(
                    one,
                    launch_arguments={
                        "namespace": name,
                        **given,
                        "duration": LaunchConfiguration("duration"),
                    }.items(),
                )
            ],
            scoped=True,
        )
        for name, given in AIRCRAFT.items()
    ]
    return LaunchDescription([duration, *loops])
